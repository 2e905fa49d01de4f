# SPDX-License-Identifier: GPL-3.0-or-later
"""A cloud on the device, and the one way to read a splat from it: kernels never touch its arrays themselves.

It holds splats in full precision or quantised (`maths.packing`); `quantise` makes the latter. Consecutive splats form
groups, with bounds in `groups`.
"""

from __future__ import annotations

import numpy as np
import warp as wp

from .edit.state import acts, shown
from .edit.state_bits import HIGHLIGHT
from .groups import SplatGroups
from .maths.packing import unpack_colour, unpack_largest_scale, unpack_position, unpack_rotation, unpack_scale
from .maths.sh import SH_C0, rest_count_of_degree, sh_basis
from .splats import SH_REST_COUNT, SplatCloud, rest_words_of_degree

wp.set_module_options({"enable_backward": False})

HIGHLIGHT_COLOUR = wp.constant(wp.vec3(*HIGHLIGHT))


@wp.struct
class DeviceCloud:
    """N splats. Of a quantised cloud the arrays in full precision are empty, of others the packed ones.

    A quantised cloud's `splat_count` includes a few empty splats (opacity 0) that fill up groups.
    """

    splat_count: wp.int32
    sh_degree: wp.int32
    rest_count: wp.int32  # coefficients per channel above band 0
    rest_words: wp.int32  # of `packed_rest` per splat
    is_quantised: wp.int32
    groups: SplatGroups

    position: wp.array(dtype=wp.vec3)
    scale: wp.array(dtype=wp.vec3)
    rotation: wp.array(dtype=wp.vec4)
    opacity: wp.array(dtype=wp.float32)
    sh_dc: wp.array(dtype=wp.vec3)  # of quantised clouds with harmonics, too
    sh_rest: wp.array(dtype=wp.vec3)  # rest_count per splat

    packed_geometry: wp.array(dtype=wp.vec4ui)  # mean, scale, rotation
    packed_opacity: wp.array(dtype=wp.uint8)
    packed_colour: wp.array(dtype=wp.uint32)  # of clouds without harmonics
    packed_rest: wp.array(dtype=wp.uint32)  # four coefficients each, as they follow each other: r, g, b, r, …
    rest_largest: wp.array(dtype=wp.float32)  # of a splat's coefficients, what 8 bits are relative to

    state: wp.array(dtype=wp.uint32)  # flags of `edit.state` while it is edited, in the cloud's own order; or empty


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
    if cloud.is_quantised != 0:
        group = i >> cloud.groups.shift
        packed = cloud.packed_geometry[i]
        splat.position = unpack_position(packed, cloud.groups.packed_low[group], cloud.groups.packed_span[group])
        splat.scale = unpack_scale(packed, cloud.groups.packed_log_scale[group])
        splat.opacity = float(cloud.packed_opacity[i]) * 0.003921569
    else:
        splat.position = cloud.position[i]
        splat.scale = cloud.scale[i]
        splat.opacity = cloud.opacity[i]
    if cloud.state.shape[0] > 0 and not shown(cloud.state[i]):
        splat.opacity = 0.0
    return splat


@wp.func
def read_ball(cloud: DeviceCloud, i: wp.int32) -> Splat:
    """As `read_splat`, with the largest scale along all axes: enough to tell that a splat is not seen, and cheaper."""
    splat = Splat()
    largest = float(0.0)
    if cloud.is_quantised != 0:
        group = i >> cloud.groups.shift
        packed = cloud.packed_geometry[i]
        splat.position = unpack_position(packed, cloud.groups.packed_low[group], cloud.groups.packed_span[group])
        largest = unpack_largest_scale(packed, cloud.groups.packed_log_scale[group])
        splat.opacity = float(cloud.packed_opacity[i]) * 0.003921569
    else:
        splat.position = cloud.position[i]
        largest = wp.max(cloud.scale[i])
        splat.opacity = cloud.opacity[i]
    splat.scale = wp.vec3(largest, largest, largest)
    if cloud.state.shape[0] > 0 and not shown(cloud.state[i]):
        splat.opacity = 0.0
    return splat


@wp.func
def read_rotation(cloud: DeviceCloud, i: wp.int32) -> wp.vec4:
    """Unit quaternion w, x, y, z from the principal axes to object space."""
    if cloud.is_quantised != 0:
        return unpack_rotation(cloud.packed_geometry[i])
    return cloud.rotation[i]


@wp.func
def read_dc(cloud: DeviceCloud, i: wp.int32) -> wp.vec3:
    """Raw coefficient of band 0."""
    if cloud.is_quantised != 0 and cloud.sh_degree == 0:
        colour = unpack_colour(cloud.packed_colour[i], cloud.groups.packed_brightest[i >> cloud.groups.shift])
        return (colour - wp.vec3(0.5, 0.5, 0.5)) / SH_C0
    return cloud.sh_dc[i]


@wp.func
def read_rest(cloud: DeviceCloud, i: wp.int32, k: wp.int32) -> wp.vec3:
    """Raw coefficient number `k` above band 0, counted through the bands as in a file."""
    if cloud.is_quantised != 0:
        first = wp.int64(i) * wp.int64(cloud.rest_words)
        step = cloud.rest_largest[i] * 0.007874016
        value = wp.vec3()
        for channel in range(3):
            byte = 3 * k + channel
            word = cloud.packed_rest[first + wp.int64(byte >> 2)]
            value[channel] = (float((word >> wp.uint32(8 * (byte & 3))) & wp.uint32(255)) - 128.0) * step
        return value
    return cloud.sh_rest[wp.int64(i) * wp.int64(cloud.rest_count) + wp.int64(k)]


@wp.func
def read_colour(cloud: DeviceCloud, i: wp.int32, degree: wp.int32, direction: wp.vec3) -> wp.vec3:
    """Colour max(0, ½ + Σ c Y) as trained (sRGB-encoded; may exceed 1), seen along a unit vector in object space.

    `degree` is the highest band evaluated of those that the cloud has.
    """
    bands = wp.min(degree, cloud.sh_degree)
    colour = wp.vec3(0.5, 0.5, 0.5) + SH_C0 * read_dc(cloud, i)
    if bands > 0:
        basis = sh_basis(bands, direction)
        for k in range(rest_count_of_degree(bands)):
            colour += basis[k] * read_rest(cloud, i, k)
    if cloud.state.shape[0] > 0 and acts(cloud.state[i]):
        colour = 0.5 * (colour + HIGHLIGHT_COLOUR)
    return wp.vec3(wp.max(colour[0], 0.0), wp.max(colour[1], 0.0), wp.max(colour[2], 0.0))


def empty_cloud(splat_count: int, sh_degree: int) -> DeviceCloud:
    """The counts filled in and every array empty."""
    cloud = DeviceCloud()
    cloud.splat_count, cloud.sh_degree = splat_count, sh_degree
    cloud.rest_count, cloud.rest_words = SH_REST_COUNT[sh_degree], rest_words_of_degree(sh_degree)
    return cloud


def upload_cloud(cloud: SplatCloud, device: wp.Device) -> DeviceCloud:
    """Copy a cloud to the device in full precision; on a CPU nothing is copied and the cloud must outlive the result.

    Its groups have no bounds yet: `group_bounds.bound_groups` finds them.
    """
    result = empty_cloud(cloud.splat_count, cloud.sh_degree)
    result.position = to_device(cloud.position, wp.vec3, device)
    result.scale = to_device(cloud.scale, wp.vec3, device)
    result.rotation = to_device(cloud.rotation, wp.vec4, device)
    result.opacity = to_device(cloud.opacity, wp.float32, device)
    result.sh_dc = to_device(cloud.sh_dc, wp.vec3, device)
    result.sh_rest = to_device(cloud.sh_rest.reshape(-1, 3), wp.vec3, device)
    return result


def with_state(cloud: DeviceCloud, state: wp.array) -> DeviceCloud:
    """The same cloud, its arrays shared, under the flags (N,) uint32 of an edit, in the cloud's own order."""
    result = DeviceCloud()
    for name in DeviceCloud.vars:  # type: ignore[attr-defined]
        setattr(result, name, getattr(cloud, name))
    result.state = state
    return result


def to_device(array: np.ndarray, dtype: object, device: wp.Device) -> wp.array:
    """The array on the device; on a CPU a view of it, which must not outlive it."""
    if device.is_cuda:
        return wp.from_numpy(array, dtype=dtype, device=device)
    count = len(array)
    if count == 0:
        return wp.empty(0, dtype=dtype, device=device)
    return wp.array(
        ptr=array.ctypes.data, dtype=dtype, shape=(count,), device=device, capacity=array.nbytes, copy=False
    )
