# SPDX-License-Identifier: GPL-3.0-or-later
"""Launches in the background of an interface: of low priority, and cut short when nobody waits for them any more."""

from __future__ import annotations

import os
import sys
import threading
from collections.abc import Iterator

import numpy as np
import pytest
import warp as wp

from stipple.engine import device as engine_device
from stipple.engine.errors import Cancelled
from stipple.engine.giving_way import NICENESS, giving_way, lower_priority

wp.set_module_options({"enable_backward": False})
COUNT = 1 << 16


@wp.kernel
def count_up_kernel(first: wp.int32, values: wp.array(dtype=wp.int32)) -> None:
    i = first + wp.tid()
    values[i] = values[i] + 1


@pytest.fixture(autouse=True)
def two_threads() -> Iterator[None]:
    before = engine_device.thread_count()
    engine_device.set_thread_count(2)
    yield
    engine_device.set_thread_count(before)
    engine_device.close_pools()


def launch(values: wp.array) -> None:
    engine_device.launch(count_up_kernel, COUNT, [values], wp.get_device("cpu"))


def test_a_launch_that_nobody_interrupts_is_whole() -> None:
    values = wp.zeros(COUNT, dtype=wp.int32, device="cpu")
    with giving_way(lambda: False):
        launch(values)
    assert (values.numpy() == 1).all()


def test_an_interrupted_launch_ends_early_and_the_next_is_whole() -> None:
    values = wp.zeros(COUNT, dtype=wp.int32, device="cpu")
    asked = []
    with pytest.raises(Cancelled), giving_way(lambda: asked.append(1) or len(asked) > 3):
        launch(values)
    done = int(values.numpy().sum())
    assert 0 < done < COUNT
    launch(values)
    assert int(values.numpy().sum()) == done + COUNT
    assert np.isin(values.numpy(), (1, 2)).all()


@pytest.mark.skipif(sys.platform != "linux", reason="asks Linux for the priority of a thread")
def test_only_launches_that_give_way_have_a_low_priority() -> None:
    def niceness() -> int:
        return os.getpriority(os.PRIO_PROCESS, threading.get_native_id())

    own = niceness()
    if own + NICENESS > 19:
        pytest.skip("the tests run at so low a priority that there is no lower one")
    with giving_way(lambda: False):
        background = engine_device._pool(2).submit(niceness).result()
    assert engine_device._pool(2).submit(niceness).result() == own == niceness()
    assert background == own + NICENESS


@pytest.mark.skipif(sys.platform != "linux", reason="asks Linux for the priority of a thread")
def test_a_priority_is_lowered_for_one_thread_only_and_never_fails() -> None:
    seen = []

    def lower_often() -> None:
        for _ in range(3):
            lower_priority()
        seen.append(os.getpriority(os.PRIO_PROCESS, threading.get_native_id()))

    own = os.getpriority(os.PRIO_PROCESS, threading.get_native_id())
    thread = threading.Thread(target=lower_often)
    thread.start()
    thread.join()
    assert seen == [min(own + 3 * NICENESS, 19)]
    assert os.getpriority(os.PRIO_PROCESS, threading.get_native_id()) == own
