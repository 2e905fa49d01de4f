# SPDX-License-Identifier: GPL-3.0-or-later
"""The kernels of edits are loaded beside the interface, and who is too early is told so."""

from __future__ import annotations

import time
from collections.abc import Iterator

import pytest

from stipple.addon import residency
from stipple.addon.edit import kernels
from stipple.engine.errors import StippleError

pytestmark = pytest.mark.blender


@pytest.fixture(autouse=True)
def nothing_prepared(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    monkeypatch.setattr(residency, "_prepared", set())
    yield
    kernels.stop()


def wait_until_ready() -> None:
    end = time.monotonic() + 120
    while not kernels.is_ready("cpu"):
        assert time.monotonic() < end
        time.sleep(0.01)


def test_who_is_too_early_is_told_how_far_it_is() -> None:
    kernels.check_ready("cpu")  # scripts and the background wait: nothing is refused, nothing begins
    assert not kernels._threads
    with residency.worker.final_render(lambda: None):  # so that it cannot go on
        kernels.begin("cpu")
        thread = kernels._threads[0]
        kernels.begin("cpu")
        assert kernels._threads == [thread]
        with pytest.raises(StippleError, match="only the first time"):
            kernels.check_ready("cpu")
    wait_until_ready()
    thread.join()
    kernels.check_ready("cpu")
    kernels.begin("cpu")
    assert kernels._threads == [thread]


def test_others_have_their_turn_between_modules() -> None:
    """A final render that waits does not wait for all modules."""
    said = []
    turns = residency.worker.final_render
    residency.prepare("cpu", "edit", lambda fraction, text: said.append(text), lambda: turns(lambda: None))
    assert residency.is_prepared("cpu", "edit") and len(said) > 10
    assert not residency.worker.serves_finals


def test_it_stops_and_begins_again() -> None:
    with residency.worker.final_render(lambda: None):
        kernels.begin("cpu")
        kernels.stop()
    assert not kernels._threads and not kernels.is_ready("cpu")
    kernels.begin("cpu")
    wait_until_ready()


def test_a_device_that_is_not_there_is_named_by_the_edit_itself() -> None:
    kernels.begin("cuda:7")
    kernels._threads[0].join()
    kernels.check_ready("cuda:7")
    with pytest.raises(StippleError, match="cuda:7"):
        residency.prepare("cuda:7", "edit", lambda fraction, text: None)
    kernels._failed.clear()
