# SPDX-License-Identifier: GPL-3.0-or-later
"""Renders that cannot be, fail or are stopped: a sentence, no black frame, and the next render works."""

from __future__ import annotations

import os
import signal
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from stipple.addon.render_engine import Progress
from stipple.engine.errors import Cancelled

from .captures import add_camera, add_capture, random_cloud, render, use_stipple

pytestmark = pytest.mark.blender


def assert_fails(tmp_path: Path, sentence: str, **options: Any) -> None:
    """Rendering stops with the sentence and saves nothing."""
    with pytest.raises(RuntimeError, match=sentence) as caught:
        render(tmp_path / "failed.png", **options)
    assert "Traceback" not in str(caught.value)
    assert not list(tmp_path.glob("failed*"))


def test_a_panoramic_camera_is_refused(tmp_path: Path) -> None:
    use_stipple()
    add_camera().data.type = "PANO"
    add_capture(random_cloud())
    assert_fails(tmp_path, "set Lens > Type to Perspective")


def test_a_broken_capture_is_refused_and_stops_the_animation(tmp_path: Path) -> None:
    b_scene = use_stipple()
    add_camera()
    b_data = add_capture(random_cloud(), "Statue").data
    b_data.attributes.remove(b_data.attributes["rotation"])
    b_scene.frame_end = 3
    assert_fails(tmp_path, "Statue: the point attribute 'rotation' is missing")
    assert_fails(tmp_path, "Statue: the point attribute 'rotation' is missing", animation=True)


def test_an_unexpected_error_is_one_sentence_and_a_log(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    use_stipple()
    add_camera()
    add_capture(random_cloud())

    def broken(*_: object) -> None:
        raise ZeroDivisionError("planted")

    monkeypatch.setattr("stipple.addon.sync.scene_from_depsgraph", broken)
    assert_fails(tmp_path, r"Stipple could not render: ZeroDivisionError: planted \(details are in the console\)")
    assert "planted" in caplog.text and "Traceback" in caplog.text


def test_no_memory_is_one_sentence(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    use_stipple()
    add_camera()
    add_capture(random_cloud())

    def greedy(*_: object) -> None:
        np.empty(1 << 60, np.uint8)

    monkeypatch.setattr("stipple.addon.sync.scene_from_depsgraph", greedy)
    assert_fails(tmp_path, "Stipple ran out of memory")


@pytest.fixture
def interrupts() -> Iterator[None]:
    """Python's own handler of SIGINT, also where a shell started this process in the background and ignores it."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.mark.usefixtures("interrupts")
def test_an_interrupt_stops_a_long_render_within_a_second(tmp_path: Path) -> None:
    """Ctrl-C of a script; Escape in the window takes the same way through `Progress`."""
    b_scene = use_stipple(method="POINTS")
    add_camera()
    add_capture(random_cloud())
    render(tmp_path / "warm.png")  # kernels are compiled
    b_scene.stipple.samples = 1 << 20
    sent: list[float] = []

    def interrupt() -> None:
        sent.append(time.monotonic())
        os.kill(os.getpid(), signal.SIGINT)

    timer = threading.Timer(0.5, interrupt)
    timer.start()
    assert_fails(tmp_path, "interrupted from the keyboard")
    assert sent and time.monotonic() - sent[0] < 1
    b_scene.stipple.samples = 1
    assert render(tmp_path / "after.png").max() > 0  # and the next render works


def test_a_cancelled_render_stops_within_a_second_and_keeps_what_is_done(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What Escape leads to. Blender answers `test_break` only to a key in a window, so the answer is planted here."""
    b_scene = use_stipple(method="POINTS")
    add_camera()
    add_capture(random_cloud())
    whole = render(tmp_path / "whole.exr")  # and kernels are compiled
    b_scene.stipple.samples = 1 << 20
    pressed = time.monotonic() + 0.5

    class Impatient(Progress):
        def __call__(self, fraction: float, text: str) -> None:
            super().__call__(fraction, text)
            if time.monotonic() > pressed:
                raise Cancelled

    monkeypatch.setattr("stipple.addon.render_engine.Progress", Impatient)
    kept = render(tmp_path / "kept.exr")
    assert time.monotonic() - pressed < 1
    assert np.abs(kept - whole).mean() < 0.1 and kept[..., :3].max() > 0.1
