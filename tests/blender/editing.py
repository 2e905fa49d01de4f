# SPDX-License-Identifier: GPL-3.0-or-later
"""Captures in Edit Splats, and every byte of what they hold."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import bpy
import numpy as np

from stipple.addon.point_rows import COLUMNS
from stipple.addon.splat_data import cloud_from_datablock, states_of
from stipple.engine.splats import SplatCloud

from .captures import ARRAYS, add_capture, random_cloud

Bytes = dict[str, tuple[str, bytes]]


def edited(cloud: SplatCloud | None = None, name: str = "Capture") -> Any:
    """An active capture in Edit Splats, and an undo stack that begins with it."""
    b_object = add_capture(cloud or random_cloud(), name)
    activate(b_object)
    assert bpy.ops.stipple.edit_mode_toggle() == {"FINISHED"}
    bpy.ops.ed.undo_push(message="Start")
    return b_object


def activate(b_object: Any) -> None:
    for b_other in bpy.context.view_layer.objects.selected:
        b_other.select_set(False)
    b_object.select_set(True)
    bpy.context.view_layer.objects.active = b_object


def every_byte(b_data: Any) -> Bytes:
    """Type and bytes of every point attribute."""
    found = {}
    for b_attribute in b_data.attributes:
        if b_attribute.domain == "POINT" and not b_attribute.name.startswith("."):
            element, width, kind = COLUMNS[b_attribute.data_type]
            values = np.empty(len(b_attribute.data) * width, kind)
            b_attribute.data.foreach_get(element, values)
            found[b_attribute.name] = (b_attribute.data_type, values.tobytes())
    return found


def flags(b_object: Any, bit: int) -> np.ndarray:
    """Which points have a flag (N,)."""
    states = states_of(b_object.data)
    count = len(b_object.data.attributes["position"].data)
    return np.zeros(count, bool) if states is None else (states & bit) != 0


def positions(b_object: Any) -> np.ndarray:
    values = np.empty(len(b_object.data.attributes["position"].data) * 3, np.float32)
    b_object.data.attributes["position"].data.foreach_get("vector", values)
    return values.reshape(-1, 3)


@contextmanager
def refused(*words: str) -> Iterator[None]:
    """An operator reports an error that has all of the words."""
    try:
        yield
    except RuntimeError as error:
        for word in words:
            assert word in str(error), (word, str(error))
        return
    raise AssertionError("the operator reported no error")


def cloud_of(b_object: Any) -> SplatCloud:
    cloud, dropped = cloud_from_datablock(b_object.data, b_object.name)
    assert cloud is not None and dropped == 0
    return cloud


def assert_close(left: SplatCloud, right: SplatCloud, tolerance: float = 2e-6) -> None:
    for name in ARRAYS:
        assert np.allclose(getattr(left, name), getattr(right, name), rtol=tolerance, atol=tolerance), name


def part(cloud: SplatCloud, rows: np.ndarray) -> SplatCloud:
    return SplatCloud(**{name: getattr(cloud, name)[rows] for name in ARRAYS})
