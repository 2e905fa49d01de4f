# SPDX-License-Identifier: GPL-3.0-or-later
"""An edit in Solid shading, where Blender draws points and `overlay` colors them: the flags of the points.

What is deleted, and while editing what is hidden, gets a radius of 0: then Blender neither draws nor outlines nor
selects it. The points of a linked capture's proxy are every so many splats of its file, and have their flags.
"""

from __future__ import annotations

from typing import Any

import bpy
import numpy as np
import numpy.typing as npt

from ...engine.edit.state_bits import DELETED, HIDDEN, LOCKED, SELECTED
from ...engine.errors import StippleError
from ...engine.splats import SplatCloud
from ..linked_capture import is_linked
from ..linked_edits import found_edits
from ..splat_data import BASE, display_radius, read_attribute, splat_count_of, states_of, write_attribute

NOT_SHOWN = HIDDEN | DELETED


def seen_flags(editing: bool, highlight: bool) -> int:
    """The flags that count in a viewport: outside of Edit Splats only what is deleted is no longer there."""
    seen = DELETED
    if editing:
        seen |= HIDDEN | LOCKED
        if highlight:
            seen |= SELECTED
    return seen


def point_states(b_data: Any) -> npt.NDArray[np.uint32] | None:
    """The flags of a datablock's points (N,), original or evaluated; None where none is known."""
    if not is_linked(b_data):
        return states_of(b_data)
    step, count = b_data.stipple_capture.proxy_step, splat_count_of(b_data)
    try:
        found = found_edits(b_data, b_data.name) if step else None
    except StippleError:  # which viewports and the panel tell
        found = None
    if found is None or -(-found.edits.splat_count // step) != count:
        return None
    return found.edits.states_at(np.arange(count, dtype=np.int64) * step)


def show_points(b_data: Any, editing: bool, cloud: SplatCloud | None = None) -> None:
    """Gives the points the radii that Blender is to draw them with; of meshes it draws none.

    Writes nothing where what has no radius is what is not shown. `cloud` is what the datablock holds, where that is
    known: what is not read is not copied in Blender's undo.
    """
    if not isinstance(b_data, bpy.types.PointCloud):
        return
    states, name = point_states(b_data), b_data.name
    left_out = np.zeros(splat_count_of(b_data), bool)
    if states is not None:
        left_out = (states & np.uint32(NOT_SHOWN & seen_flags(editing, False))) != 0
    try:
        if np.array_equal(read_attribute(b_data, "radius", name)[:, 0] == 0, left_out):
            return
        if cloud is None:
            radius = display_radius(read_attribute(b_data, "scale", name), read_attribute(b_data, BASE, name)[:, 3])
        else:
            radius = display_radius(cloud.scale, cloud.opacity)
    except StippleError:  # broken attributes: what shows the capture says so
        return
    radius[left_out] = 0
    write_attribute(b_data, "radius", "FLOAT", radius)
    b_data.update_tag()
