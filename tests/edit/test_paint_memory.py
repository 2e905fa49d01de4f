# SPDX-License-Identifier: GPL-3.0-or-later
"""Painting: the memory of strokes, and what is refused."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from stipple.engine.edit.brush import Brush
from stipple.engine.edit.editable_cloud import EditableCloud
from stipple.engine.edit.history import History
from stipple.engine.edit.paint_stroke import PaintStroke
from stipple.engine.errors import StippleError
from tests.edit.every_byte import assert_same, every_byte
from tests.edit.strokes import COLOUR, DABS, stroke

Clouds = Callable[..., EditableCloud]


def test_strokes_share_memory_one_after_the_other_and_not_at_once(make_cloud: Clouds) -> None:
    cloud = make_cloud(3000, 1, 1)
    before = every_byte(cloud)
    first = stroke(cloud, Brush("rgb", COLOUR))
    first.cancel()
    held = cloud.held_bytes
    second, third = (stroke(cloud, Brush("darken"), DABS[at : at + 1]) for at in (0, 2))
    third.cancel()
    second.cancel()
    first.cancel()  # is over
    assert_same(cloud, before)
    history = History(cloud)
    for _ in range(3):
        history.record(stroke(cloud, Brush("rgb", COLOUR)).finish())
    assert cloud.held_bytes <= held + 4 * cloud.splat_count
    history.go_to(0)
    assert_same(cloud, before)


def test_bad_calls_leave_everything(make_cloud: Clouds, monkeypatch: pytest.MonkeyPatch) -> None:
    for wrong in (
        {"mode": "spray"},
        {"falloff": "root"},
        {"strength": 1.5},
        {"colour": (2, 0, 0)},
        {"opacity": np.nan},
    ):
        with pytest.raises(StippleError, match="brush"):
            Brush(**wrong)
    cloud = make_cloud(3000, 1, 2)
    before = every_byte(cloud)
    with pytest.raises(StippleError, match="radius"):
        PaintStroke(cloud, Brush()).dab((0, 0, 0), -1)
    assert PaintStroke(cloud, Brush()).finish() is None
    running, fresh = stroke(cloud, Brush("rgb", COLOUR)), make_cloud(3000, 1, 2)
    for free in (100, 20_000, 30_000, 70_000, 300_000):  # in turn each of the five arrays is one too many
        monkeypatch.setattr("stipple.engine.buffers.free_bytes", lambda device, free=free: free)
        if free < 300_000:
            with pytest.raises(StippleError, match="are needed"):
                PaintStroke(fresh, Brush())
        assert_same(fresh, before)
    monkeypatch.setattr("stipple.engine.buffers.free_bytes", lambda device: 100)
    with pytest.raises(StippleError, match="are needed"):
        running.finish()
    assert_same(cloud, before)
