# SPDX-License-Identifier: GPL-3.0-or-later
"""Stage 1 of both methods: from all splats of all instances to a list of what the camera can see.

Two passes over the splats: `mark_visible` is cheap and conservative, and after a prefix sum `stage_splats` projects
and colours the survivors into consecutive records, in the order instance, splat. (One pass with an atomic counter
would give the records another order in every run.)
"""

from __future__ import annotations

from dataclasses import dataclass

import warp as wp

from .buffers import Buffers
from .device import launch
from .device_cloud import DeviceCloud, read_colour, read_rotation, read_splat
from .maths.projection import Pose, View, may_be_seen, project_splat

wp.set_module_options({"enable_backward": False})


@wp.struct
class Staged:
    """What the camera sees, one record per visible splat; equal indices in all arrays."""

    centre: wp.array(dtype=wp.vec4)  # mean x, y [px of the window], depth z [world units], opacity
    covariance: wp.array(dtype=wp.vec4)  # xx, xy, yy [px²], determinant [px⁴]; dilated
    colour: wp.array(dtype=wp.vec3)  # as trained (sRGB-encoded), >= 0, may exceed 1
    splat: wp.array(dtype=wp.int32)  # index in its cloud
    instance: wp.array(dtype=wp.int32)


@dataclass(frozen=True)
class Staging:
    """The staged records and how many there are."""

    arrays: Staged
    count: int


@wp.kernel
def mark_visible_kernel(
    first: wp.int32, cloud: DeviceCloud, view: View, pose: Pose, offset: wp.int32, visible: wp.array(dtype=wp.int32)
) -> None:
    i = first + wp.tid()
    splat = read_splat(cloud, i)
    seen = may_be_seen(view, pose, splat.position, splat.scale, splat.opacity)
    visible[offset + i] = wp.where(seen, 1, 0)


@wp.kernel
def stage_splats_kernel(
    first: wp.int32,
    cloud: DeviceCloud,
    view: View,
    pose: Pose,
    instance: wp.int32,
    offset: wp.int32,
    visible: wp.array(dtype=wp.int32),
    staged_from_splat: wp.array(dtype=wp.int32),  # exclusive prefix sum of visible
    staged: Staged,
) -> None:
    i = first + wp.tid()
    if visible[offset + i] == 0:
        return
    j = staged_from_splat[offset + i]
    splat = read_splat(cloud, i)
    p = pose.linear * splat.position + pose.translation
    e = project_splat(view, pose, p, splat.scale, read_rotation(cloud, i), splat.opacity)
    direction = wp.normalize(splat.position - pose.eye_object)
    if view.orthographic != 0:
        direction = pose.forward_object
    staged.centre[j] = wp.vec4(e.mean_px[0], e.mean_px[1], p[2], e.opacity)
    staged.covariance[j] = wp.vec4(e.xx, e.xy, e.yy, e.determinant)
    staged.colour[j] = read_colour(cloud, i, view.sh_degree, direction)
    staged.splat[j] = i
    staged.instance[j] = instance


def stage_splats(clouds: list[DeviceCloud], poses: list[Pose], view: View, buffers: Buffers) -> Staging:
    """Project all splats of all instances; `clouds` and `poses` run in parallel, one pair per instance."""
    device = buffers.device
    offsets = [0]
    for cloud in clouds:
        offsets.append(offsets[-1] + cloud.splat_count)
    total = offsets[-1]
    visible = buffers.array("visible", wp.int32, total)
    staged_from_splat = buffers.array("staged_from_splat", wp.int32, total)
    for cloud, pose, offset in zip(clouds, poses, offsets, strict=False):
        launch(mark_visible_kernel, cloud.splat_count, [cloud, view, pose, offset, visible], device)
    wp.utils.array_scan(visible, staged_from_splat, inclusive=False)
    count = int(staged_from_splat[-1:].numpy()[0] + visible[-1:].numpy()[0]) if total else 0
    staged = Staged()
    staged.centre = buffers.array("staged_centre", wp.vec4, count)
    staged.covariance = buffers.array("staged_covariance", wp.vec4, count)
    staged.colour = buffers.array("staged_colour", wp.vec3, count)
    staged.splat = buffers.array("staged_splat", wp.int32, count)
    staged.instance = buffers.array("staged_instance", wp.int32, count)
    for index, (cloud, pose, offset) in enumerate(zip(clouds, poses, offsets, strict=False)):
        inputs = [cloud, view, pose, index, offset, visible, staged_from_splat, staged]
        launch(stage_splats_kernel, cloud.splat_count, inputs, device)
    return Staging(staged, count)
