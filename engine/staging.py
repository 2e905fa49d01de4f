# SPDX-License-Identifier: GPL-3.0-or-later
"""Stage 1 of both methods: from all splats of all instances to a list of what the camera can see.

Two passes over the splats: `mark_visible` is cheap and conservative, and after a prefix sum `stage_splats` projects
and colours the survivors into consecutive records, in the order instance, splat. (One pass with an atomic counter
would give the records another order in every run.)
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import warp as wp

from .buffers import Buffers
from .device import launch
from .maths.projection import Pose, View, may_be_seen, project_splat
from .maths.sh import sh_colour
from .splats import SH_REST_COUNT, SplatCloud

wp.set_module_options({"enable_backward": False})


@wp.struct
class DeviceCloud:
    """A `SplatCloud` on the device; on a CPU, views of the host's arrays."""

    position: wp.array(dtype=wp.vec3)
    scale: wp.array(dtype=wp.vec3)
    rotation: wp.array(dtype=wp.vec4)
    opacity: wp.array(dtype=wp.float32)
    sh_dc: wp.array(dtype=wp.vec3)
    sh_rest: wp.array(dtype=wp.vec3)  # rest_count per splat
    rest_count: wp.int32
    sh_degree: wp.int32


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


def upload_cloud(cloud: SplatCloud, device: wp.Device) -> DeviceCloud:
    """Copy a cloud to the device; on a CPU nothing is copied and the cloud must outlive the result."""

    def upload(array: np.ndarray, dtype: object) -> wp.array:
        return wp.from_numpy(array, dtype=dtype, device=device) if device.is_cuda else _view(array, dtype, device)

    result = DeviceCloud()
    result.position = upload(cloud.position, wp.vec3)
    result.scale = upload(cloud.scale, wp.vec3)
    result.rotation = upload(cloud.rotation, wp.vec4)
    result.opacity = upload(cloud.opacity, wp.float32)
    result.sh_dc = upload(cloud.sh_dc, wp.vec3)
    result.sh_rest = upload(cloud.sh_rest.reshape(-1, 3), wp.vec3)
    result.rest_count = SH_REST_COUNT[cloud.sh_degree]
    result.sh_degree = cloud.sh_degree
    return result


def _view(array: np.ndarray, dtype: object, device: wp.Device) -> wp.array:
    count = len(array)
    if count == 0:
        return wp.empty(0, dtype=dtype, device=device)
    return wp.array(
        ptr=array.ctypes.data, dtype=dtype, shape=(count,), device=device, capacity=array.nbytes, copy=False
    )


@wp.kernel
def mark_visible_kernel(
    first: wp.int32, cloud: DeviceCloud, view: View, pose: Pose, offset: wp.int32, visible: wp.array(dtype=wp.int32)
) -> None:
    i = first + wp.tid()
    seen = may_be_seen(view, pose, cloud.position[i], cloud.scale[i], cloud.opacity[i])
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
    position = cloud.position[i]
    p = pose.linear * position + pose.translation
    e = project_splat(view, pose, p, cloud.scale[i], cloud.rotation[i], cloud.opacity[i])
    direction = wp.normalize(position - pose.eye_object)
    if view.orthographic != 0:
        direction = pose.forward_object
    degree = wp.min(view.sh_degree, cloud.sh_degree)
    first_rest = wp.int64(i) * wp.int64(cloud.rest_count)
    staged.centre[j] = wp.vec4(e.mean_px[0], e.mean_px[1], p[2], e.opacity)
    staged.covariance[j] = wp.vec4(e.xx, e.xy, e.yy, e.determinant)
    staged.colour[j] = sh_colour(cloud.sh_dc[i], cloud.sh_rest, first_rest, degree, direction)
    staged.splat[j] = i
    staged.instance[j] = instance


def stage_splats(clouds: list[DeviceCloud], poses: list[Pose], view: View, buffers: Buffers) -> Staging:
    """Project all splats of all instances; `clouds` and `poses` run in parallel, one pair per instance."""
    device = buffers.device
    offsets = [0]
    for cloud in clouds:
        offsets.append(offsets[-1] + cloud.position.size)
    total = offsets[-1]
    visible = buffers.array("visible", wp.int32, total)
    staged_from_splat = buffers.array("staged_from_splat", wp.int32, total)
    for cloud, pose, offset in zip(clouds, poses, offsets, strict=False):
        launch(mark_visible_kernel, cloud.position.size, [cloud, view, pose, offset, visible], device)
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
        launch(stage_splats_kernel, cloud.position.size, inputs, device)
    return Staging(staged, count)
