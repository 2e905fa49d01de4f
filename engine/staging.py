# SPDX-License-Identifier: GPL-3.0-or-later
"""Stage 1 of *points* and *sorted*: from groups of splats to a list of what the camera can see.

Two passes over the splats: `mark_visible` is cheap and conservative, and after a prefix sum `stage_splats` projects
and colours the survivors into consecutive records, in the order instance, splat. (One pass with an atomic counter
would give the records another order in every run.)
"""

from __future__ import annotations

from dataclasses import dataclass

import warp as wp

from .buffers import Buffers
from .culling import Blocks, cull_groups
from .device import launch
from .device_cloud import DeviceCloud, read_ball, read_colour, read_rotation, read_splat
from .device_look import dressed, graded
from .maths.projection import Pose, View, depth_key, footprint, project_splat
from .occlusion import FATE_HIDDEN, Occlusion, is_left_out
from .placements import Placed, Placements

wp.set_module_options({"enable_backward": False})


@wp.struct
class Staged:
    """What the camera sees, one record per visible splat; equal indices in all arrays."""

    centre: wp.array(dtype=wp.vec4)  # mean x, y [px of the window], depth z [world units], opacity (see `device_look`)
    covariance: wp.array(dtype=wp.vec4)  # xx, xy, yy [px²], determinant [px⁴]; dilated
    # Graded, in the blend space (sRGB-encoded), >= 0, may exceed 1; empty where it is found later
    colour: wp.array(dtype=wp.vec3)
    splat: wp.array(dtype=wp.int32)  # index in its cloud
    instance: wp.array(dtype=wp.int32)


@wp.struct
class Slab:
    """Consecutive blocks that are staged together."""

    blocks: wp.array(dtype=wp.vec3i)
    begin: wp.int32
    shift: wp.int32  # log₂ of the threads per block


@dataclass(frozen=True)
class Staging:
    """The staged records and how many there are."""

    arrays: Staged
    count: int


@wp.func
def colour_of(cloud: DeviceCloud, pose: Pose, view: View, i: wp.int32, position: wp.vec3) -> wp.vec3:
    """A splat's colour as this camera and the instance's look show it (sRGB-encoded)."""
    direction = wp.normalize(position - pose.eye_object)
    if view.orthographic != 0:
        direction = pose.forward_object
    return graded(read_colour(cloud, i, pose.look.sh_degree, direction), pose.look)


@wp.kernel
def mark_visible_kernel(
    first: wp.int32, placed: Placed, view: View, occlusion: Occlusion, slab: Slab, visible: wp.array(dtype=wp.int32)
) -> None:
    thread = first + wp.tid()
    block = slab.blocks[slab.begin + (thread >> slab.shift)]
    visible[thread] = 0
    if block[2] == FATE_HIDDEN:
        return
    local = thread & ((1 << slab.shift) - 1)
    cloud = placed.cloud[block[0]]
    i = (block[1] << cloud.groups.shift) + local
    if local >= (1 << cloud.groups.shift) or i >= cloud.splat_count:
        return
    pose = placed.pose[block[0]]
    splat = dressed(read_ball(cloud, i), pose.look)
    p = pose.linear * splat.position + pose.translation
    f = footprint(view, pose, p, splat.scale, splat.opacity)
    if not f.seen:
        return
    low, high = f.low - view.window_low, f.high - view.window_low
    if not is_left_out(occlusion, block[2], low, high, depth_key(p[2], view)):
        visible[thread] = 1


@wp.kernel
def stage_splats_kernel(
    first: wp.int32,
    placed: Placed,
    view: View,
    slab: Slab,
    staged_end: wp.array(dtype=wp.int32),  # inclusive prefix sum of what is visible
    staged: Staged,
) -> None:
    thread = first + wp.tid()
    j = int(0)
    if thread > 0:
        j = staged_end[thread - 1]
    if staged_end[thread] == j:
        return
    block = slab.blocks[slab.begin + (thread >> slab.shift)]
    cloud, pose = placed.cloud[block[0]], placed.pose[block[0]]
    i = (block[1] << cloud.groups.shift) + (thread & ((1 << slab.shift) - 1))
    splat = dressed(read_splat(cloud, i), pose.look)
    p = pose.linear * splat.position + pose.translation
    e = project_splat(view, pose, p, splat.scale, read_rotation(cloud, i), splat.opacity)
    staged.centre[j] = wp.vec4(e.mean_px[0], e.mean_px[1], p[2], e.opacity)
    staged.covariance[j] = wp.vec4(e.xx, e.xy, e.yy, e.determinant)
    if staged.colour.shape[0] > 0:
        staged.colour[j] = colour_of(cloud, pose, view, i, splat.position)
    staged.splat[j] = i
    staged.instance[j] = block[0]


def stage_blocks(
    placements: Placements,
    view: View,
    occlusion: Occlusion,
    blocks: Blocks,
    begin: int,
    end: int,
    buffers: Buffers,
    *,
    coloured: bool = True,
) -> Staging:
    """Project what this phase draws of blocks `begin` … `end` - 1. Reads the number of records back."""
    placed, device = placements.placed, buffers.device
    slab = Slab()
    slab.blocks, slab.begin, slab.shift = blocks.array, begin, placements.group_shift
    threads = max(end - begin, 0) << placements.group_shift
    visible = buffers.array("visible", wp.int32, threads)
    count = 0
    if threads:
        launch(mark_visible_kernel, threads, [placed, view, occlusion, slab, visible], device)
        wp.utils.array_scan(visible, visible, inclusive=True)
        count = int(visible[-1:].numpy()[0])
    staged = Staged()
    staged.centre = buffers.array("staged_centre", wp.vec4, count)
    staged.covariance = buffers.array("staged_covariance", wp.vec4, count)
    if coloured:
        staged.colour = buffers.array("staged_colour", wp.vec3, count)
    staged.splat = buffers.array("staged_splat", wp.int32, count)
    staged.instance = buffers.array("staged_instance", wp.int32, count)
    launch(stage_splats_kernel, threads, [placed, view, slab, visible, staged], device)
    return Staging(staged, count)


def stage_all(placements: Placements, view: View, buffers: Buffers, *, bounded: bool = True) -> Staging:
    """Project and colour all that is in the frustum."""
    blocks = cull_groups(placements, view, buffers, bounded=bounded)
    return stage_blocks(placements, view, Occlusion(), blocks, 0, blocks.count, buffers)
