# SPDX-License-Identifier: GPL-3.0-or-later
"""A cloud on the device, and the one way to read a splat from it: kernels never touch its arrays themselves."""

from __future__ import annotations

import numpy as np
import warp as wp

from .maths.sh import sh_colour
from .splats import SH_REST_COUNT, SplatCloud

wp.set_module_options({"enable_backward": False})


@wp.struct
class DeviceCloud:
    """A `SplatCloud` on the device; on a CPU, views of the host's arrays."""

    splat_count: wp.int32
    position: wp.array(dtype=wp.vec3)
    scale: wp.array(dtype=wp.vec3)
    rotation: wp.array(dtype=wp.vec4)
    opacity: wp.array(dtype=wp.float32)
    sh_dc: wp.array(dtype=wp.vec3)
    sh_rest: wp.array(dtype=wp.vec3)  # rest_count per splat
    rest_count: wp.int32
    sh_degree: wp.int32


@wp.struct
class Splat:
    """A splat in object space, without its colour."""

    position: wp.vec3
    scale: wp.vec3  # standard deviations along the principal axes
    opacity: wp.float32


@wp.func
def read_splat(cloud: DeviceCloud, i: wp.int32) -> Splat:
    """Everything that decides whether a splat can be seen."""
    splat = Splat()
    splat.position = cloud.position[i]
    splat.scale = cloud.scale[i]
    splat.opacity = cloud.opacity[i]
    return splat


@wp.func
def read_rotation(cloud: DeviceCloud, i: wp.int32) -> wp.vec4:
    """Unit quaternion w, x, y, z from the principal axes to object space."""
    return cloud.rotation[i]


@wp.func
def read_colour(cloud: DeviceCloud, i: wp.int32, degree: wp.int32, direction: wp.vec3) -> wp.vec3:
    """Colour as trained (sRGB-encoded, >= 0, may exceed 1) seen along a unit vector in object space.

    `degree` is the highest band evaluated of those that the cloud has.
    """
    first_rest = wp.int64(i) * wp.int64(cloud.rest_count)
    return sh_colour(cloud.sh_dc[i], cloud.sh_rest, first_rest, wp.min(degree, cloud.sh_degree), direction)


def upload_cloud(cloud: SplatCloud, device: wp.Device) -> DeviceCloud:
    """Copy a cloud to the device; on a CPU nothing is copied and the cloud must outlive the result."""

    def upload(array: np.ndarray, dtype: object) -> wp.array:
        return wp.from_numpy(array, dtype=dtype, device=device) if device.is_cuda else _view(array, dtype, device)

    result = DeviceCloud()
    result.splat_count = cloud.splat_count
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
