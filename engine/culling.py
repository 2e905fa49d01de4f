# SPDX-License-Identifier: GPL-3.0-or-later
"""Leave out whole groups of splats that no pixel can see (§3.5 of doi 10.1145/3811272): outside the frustum, or hidden.

Hidden is what lies behind everything that a depth pyramid holds. Two phases make that exact: the first draws what
the pyramid of the picture *before* does not hide, a guess; the second draws all else that the pyramid *now*, made of
what the first has drawn, does not hide. What is left out could not have won a single subpixel, so the picture is the
same bit for bit, whatever the guess was.
"""

from __future__ import annotations

from dataclasses import dataclass

import warp as wp

from .buffers import Buffers
from .depth_pyramid import DepthPyramid, build_depth_pyramid, is_hidden
from .device import launch
from .groups import SplatGroups, group_reach
from .maths.projection import Footprint, Pose, View, depth_key, touching
from .placements import Placed, Placements, instance_of

wp.set_module_options({"enable_backward": False})

ALL, NOT_HIDDEN_BEFORE, NOT_HIDDEN_NOW = 0, 1, 2  # phases; ALL is the frustum only
PHASE_BEFORE = wp.constant(NOT_HIDDEN_BEFORE)
PHASE_NOW = wp.constant(NOT_HIDDEN_NOW)
BOUNDLESS = wp.constant(1e17)  # standard deviations above this are not trusted to arithmetic


@wp.struct
class Occlusion:
    """Which phase it is, and what hides."""

    phase: wp.int32
    before: DepthPyramid
    now: DepthPyramid


class OcclusionMemory:
    """The pyramid of the sample before, of this frame or the last: the guess of the first phase.

    Two buffers take turns, so that the pyramid before is whole while the one now is built.
    """

    def __init__(self) -> None:
        self._before: tuple[tuple[int, int], DepthPyramid] | None = None
        self._turn = 0

    def first_phase(self, size: tuple[int, int]) -> Occlusion:
        """For a window of `size` [px]; a memory of another size is of no use."""
        occlusion = Occlusion()
        occlusion.phase = NOT_HIDDEN_BEFORE
        if self._before is not None and self._before[0] == size:
            occlusion.before = self._before[1]
        return occlusion

    def second_phase(
        self, first: Occlusion, visibility: wp.array, size: tuple[int, int], subpixels: int, buffers: Buffers
    ) -> Occlusion:
        """After the first phase has drawn into `visibility`; remembers that for the next sample."""
        self._turn = 1 - self._turn
        first.phase = NOT_HIDDEN_NOW
        first.now = build_depth_pyramid(visibility, *size, subpixels, f"depth_pyramid_{self._turn}", buffers)
        self._before = (size, first.now)
        return first

    def forget(self) -> None:
        self._before = None


@wp.struct
class GroupBounds:
    """A group as the camera sees it."""

    footprint: Footprint
    nearest: wp.float32  # z that no mean is in front of


@dataclass(frozen=True)
class Blocks:
    """Groups to be drawn: (instance, group, whether the first phase draws it) each, ordered by instance and group."""

    array: wp.array
    count: int


@wp.func
def slopes(low: wp.float32, high: wp.float32, near: wp.float32, far: wp.float32) -> wp.vec2:
    """Least and largest x / z for x between `low` and `high` and z between `near` and `far`, all of those > 0."""
    return wp.vec2(low / wp.where(low < 0.0, near, far), high / wp.where(high > 0.0, near, far))


@wp.func
def bound_group(view: View, pose: Pose, groups: SplatGroups, group: wp.int32) -> GroupBounds:
    """Bounds the ellipses of all splats of a group, as `footprint` bounds one.

    A standard deviation along a row r of a matrix is at most |r| · σ, σ the largest along each axis. A thousandth and
    a pixel are added for rounding.
    """
    bounds = GroupBounds()
    opacity = groups.opacity[group]
    if not opacity >= view.alpha_min or opacity <= 0.0:
        return bounds
    middle = 0.5 * (groups.low[group] + groups.high[group])
    half = 0.5 * (groups.high[group] - groups.low[group])
    sigma = groups.sigma[group]
    centre = pose.linear * middle + pose.translation
    extent = wp.vec3()
    deviation = wp.vec3()
    for k in range(3):
        row = wp.abs(pose.linear[k])
        size = wp.abs(centre[k]) + wp.dot(row, wp.abs(middle)) + wp.abs(pose.translation[k])
        extent[k] = wp.dot(row, half) * 1.0001 + 1e-6 * size
        deviation[k] = wp.dot(row, sigma)
    nearest, farthest = centre[2] - extent[2], centre[2] + extent[2]
    if farthest <= view.near or nearest >= view.far:
        return bounds
    bounds.nearest = nearest
    near = wp.max(nearest, view.near)
    x = wp.vec2(centre[0] - extent[0], centre[0] + extent[0])
    y = wp.vec2(centre[1] - extent[1], centre[1] + extent[1])
    inverse_z = float(1.0)
    if view.orthographic == 0:
        x = slopes(x[0], x[1], near, farthest)
        y = slopes(y[0], y[1], near, farthest)
        inverse_z = 1.0 / near
        tilt_x = wp.max(wp.abs(view.slope_low[0]), wp.abs(view.slope_high[0]))
        tilt_y = wp.max(wp.abs(view.slope_low[1]), wp.abs(view.slope_high[1]))
        deviation[0] = deviation[0] + tilt_x * deviation[2]
        deviation[1] = deviation[1] + tilt_y * deviation[2]
    if not wp.max(deviation) < BOUNDLESS or not wp.max(extent) < BOUNDLESS:
        bounds.footprint = touching(view, view.window_low - wp.vec2(1.0, 1.0), view.window_high + wp.vec2(1.0, 1.0))
        return bounds
    reach = group_reach(opacity, view.alpha_min) * 1.001
    sx, sy = view.focal_px[0] * inverse_z * deviation[0], view.focal_px[1] * inverse_z * deviation[1]
    rx = reach * wp.sqrt(sx * sx + view.dilation_px2) + 1.0
    ry = reach * wp.sqrt(sy * sy + view.dilation_px2) + 1.0
    low = wp.vec2(view.focal_px[0] * x[0] - rx, view.focal_px[1] * y[0] - ry) + view.centre_px
    high = wp.vec2(view.focal_px[0] * x[1] + rx, view.focal_px[1] * y[1] + ry) + view.centre_px
    bounds.footprint = touching(view, low, high)
    return bounds


@wp.kernel
def cull_groups_kernel(
    first: wp.int32,
    placed: Placed,
    view: View,
    occlusion: Occlusion,
    bounded: wp.int32,
    states: wp.array(dtype=wp.int32),
    kept: wp.array(dtype=wp.int32),
) -> None:
    number = first + wp.tid()
    instance = instance_of(placed.first_group, placed.count, wp.int64(number))
    group = number - int(placed.first_group[instance])
    state = int(1)
    if bounded != 0:
        bounds = bound_group(view, placed.pose[instance], placed.cloud[instance].groups, group)
        state = wp.where(bounds.footprint.seen, 1, 0)
        if state != 0 and occlusion.phase != 0:
            low, high = bounds.footprint.low - view.window_low, bounds.footprint.high - view.window_low
            key = depth_key(wp.max(bounds.nearest, view.near), view)
            hidden_before = is_hidden(occlusion.before, low, high, key)
            if occlusion.phase == PHASE_BEFORE:
                state = wp.where(hidden_before, 0, 1)
            elif is_hidden(occlusion.now, low, high, key):
                state = 0
            elif hidden_before:
                state = 2  # for the second phase, which need not ask what the first has drawn of it
    states[number] = state
    kept[number] = wp.where(state != 0, 1, 0)


@wp.kernel
def list_blocks_kernel(
    first: wp.int32,
    placed: Placed,
    states: wp.array(dtype=wp.int32),
    block_from_group: wp.array(dtype=wp.int32),
    blocks: wp.array(dtype=wp.vec3i),
) -> None:
    number = first + wp.tid()
    if states[number] == 0:
        return
    instance = instance_of(placed.first_group, placed.count, wp.int64(number))
    group = number - int(placed.first_group[instance])
    blocks[block_from_group[number]] = wp.vec3i(instance, group, wp.where(states[number] == 1, 1, 0))


def cull_groups(
    placements: Placements, view: View, occlusion: Occlusion, buffers: Buffers, *, bounded: bool = True
) -> Blocks:
    """The groups that this phase may have to draw; all there are, if not `bounded`. Reads their number back."""
    count = placements.group_count
    if count == 0:
        return Blocks(buffers.array("blocks", wp.vec3i, 0), 0)
    states = buffers.array("group_states", wp.int32, count)
    kept = buffers.array("group_kept", wp.int32, count)
    block_from_group = buffers.array("block_from_group", wp.int32, count)
    inputs = [placements.placed, view, occlusion, int(bounded), states, kept]
    launch(cull_groups_kernel, count, inputs, buffers.device)
    wp.utils.array_scan(kept, block_from_group, inclusive=False)
    block_count = int(block_from_group[-1:].numpy()[0] + kept[-1:].numpy()[0])
    blocks = buffers.array("blocks", wp.vec3i, block_count)
    launch(list_blocks_kernel, count, [placements.placed, states, block_from_group, blocks], buffers.device)
    return Blocks(blocks, block_count)
