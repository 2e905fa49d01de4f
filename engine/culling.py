# SPDX-License-Identifier: GPL-3.0-or-later
"""Leave out whole groups of splats that lie outside the frustum (§3.5 of doi 10.1145/3811272)."""

from __future__ import annotations

from dataclasses import dataclass

import warp as wp

from .buffers import Buffers
from .device import launch
from .device_look import dressed_opacity
from .groups import SplatGroups, group_reach
from .maths.projection import Footprint, Pose, View, touching
from .placements import Placed, Placements, instance_of

wp.set_module_options({"enable_backward": False})

FATE_NEW = wp.constant(0)  # of a block: nothing is known of it but that it is in the frustum
BOUNDLESS = wp.constant(1e17)  # standard deviations above this are not trusted to arithmetic


@wp.struct
class GroupBounds:
    """A group as the camera sees it."""

    footprint: Footprint
    nearest: wp.float32  # z that no mean is in front of


@dataclass(frozen=True)
class Blocks:
    """Groups that may have to be drawn, as (instance, group, fate); what a fate is, `occlusion` decides."""

    array: wp.array
    count: int


@wp.func
def slopes(low: wp.float32, high: wp.float32, near: wp.float32, far: wp.float32) -> wp.vec2:
    """Least and largest x / z for x between `low` and `high` and z between `near` and `far`, all of those > 0."""
    return wp.vec2(low / wp.where(low < 0.0, near, far), high / wp.where(high > 0.0, near, far))


@wp.func
def bound_group(view: View, pose: Pose, groups: SplatGroups, group: wp.int32) -> GroupBounds:
    """Bounds the ellipses of all splats of a group, as `footprint` bounds one.

    Of what the instance's look shows, but for its crops.

    A standard deviation along a row r of a matrix is at most |r| · σ, σ the largest along each axis. A thousandth and
    a pixel are added for rounding.
    """
    bounds = GroupBounds()
    opacity = dressed_opacity(groups.opacity[group], pose.look)
    if not opacity >= view.alpha_min or opacity <= 0.0:
        return bounds
    middle = 0.5 * (groups.low[group] + groups.high[group])
    half = 0.5 * (groups.high[group] - groups.low[group])
    sigma = pose.look.size * groups.sigma[group]
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
    rx = reach * wp.sqrt(sx * sx + pose.look.dilation_px2) + 1.0
    ry = reach * wp.sqrt(sy * sy + pose.look.dilation_px2) + 1.0
    low = wp.vec2(view.focal_px[0] * x[0] - rx, view.focal_px[1] * y[0] - ry) + view.centre_px
    high = wp.vec2(view.focal_px[0] * x[1] + rx, view.focal_px[1] * y[1] + ry) + view.centre_px
    bounds.footprint = touching(view, low, high)
    return bounds


@wp.kernel
def cull_groups_kernel(
    first: wp.int32, placed: Placed, view: View, bounded: wp.int32, kept: wp.array(dtype=wp.int32)
) -> None:
    number = first + wp.tid()
    instance = instance_of(placed.first_group, placed.count, wp.int64(number))
    group = number - int(placed.first_group[instance])
    seen = bool(True)
    if bounded != 0:
        seen = bound_group(view, placed.pose[instance], placed.cloud[instance].groups, group).footprint.seen
    kept[number] = wp.where(seen, 1, 0)


@wp.kernel
def list_groups_kernel(
    first: wp.int32,
    placed: Placed,
    kept: wp.array(dtype=wp.int32),
    block_from_group: wp.array(dtype=wp.int32),
    blocks: wp.array(dtype=wp.vec3i),
) -> None:
    number = first + wp.tid()
    if kept[number] != 0:
        instance = instance_of(placed.first_group, placed.count, wp.int64(number))
        group = number - int(placed.first_group[instance])
        blocks[block_from_group[number]] = wp.vec3i(instance, group, FATE_NEW)


def cull_groups(placements: Placements, view: View, buffers: Buffers, *, bounded: bool = True) -> Blocks:
    """The groups in the frustum, by instance and group; all there are, if not `bounded`. Reads their number back."""
    count = placements.group_count
    if count == 0:
        return Blocks(buffers.array("blocks", wp.vec3i, 0), 0)
    kept = buffers.array("group_kept", wp.int32, count)
    launch(cull_groups_kernel, count, [placements.placed, view, int(bounded), kept], buffers.device)
    block_from_group, block_count = _places(kept, buffers)
    blocks = buffers.array("blocks", wp.vec3i, block_count)
    launch(list_groups_kernel, count, [placements.placed, kept, block_from_group, blocks], buffers.device)
    return Blocks(blocks, block_count)


def _places(kept: wp.array, buffers: Buffers) -> tuple[wp.array, int]:
    """Where each kept entry goes in a list of them, and how many there are."""
    places = buffers.array("group_places", wp.int32, kept.size)
    wp.utils.array_scan(kept, places, inclusive=False)
    return places, int(places[-1:].numpy()[0] + kept[-1:].numpy()[0])
