# SPDX-License-Identifier: GPL-3.0-or-later
"""Read clouds on a device back as kernels see them, for tests of how they are stored."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
import warp as wp

from stipple.engine.device_cloud import DeviceCloud, read_dc, read_rest, read_rotation, read_splat
from stipple.engine.groups import group_box

wp.set_module_options({"enable_backward": False})

FloatArray = npt.NDArray[np.float32]


@dataclass(frozen=True)
class ReadBack:
    """(N, …) arrays in the order of the device, empty places left out; `place` says where they lay."""

    place: npt.NDArray[np.int64]
    position: FloatArray
    scale: FloatArray
    rotation: FloatArray
    opacity: FloatArray
    sh_dc: FloatArray
    sh_rest: FloatArray

    def covariance(self) -> npt.NDArray[np.float64]:
        return covariance_of(self.scale, self.rotation)


def covariance_of(scale: npt.ArrayLike, rotation: npt.ArrayLike) -> npt.NDArray[np.float64]:
    """R S² Rᵀ (N, 3, 3) in float64; `rotation` is w, x, y, z."""
    w, x, y, z = np.asarray(rotation, np.float64).T
    axes = np.empty((len(w), 3, 3))
    axes[:, 0] = np.stack([1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)], axis=1)
    axes[:, 1] = np.stack([2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)], axis=1)
    axes[:, 2] = np.stack([2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)], axis=1)
    half = axes * np.asarray(scale, np.float64)[:, None, :]
    return half @ np.swapaxes(half, 1, 2)


@wp.kernel
def read_back_kernel(
    cloud: DeviceCloud,
    shape: wp.array(dtype=wp.float32, ndim=2),  # position, scale, rotation, opacity, band 0
    rest: wp.array(dtype=wp.vec3, ndim=2),
) -> None:
    i = wp.tid()
    splat = read_splat(cloud, i)
    q = read_rotation(cloud, i)
    dc = read_dc(cloud, i)
    for k in range(3):
        shape[i, k] = splat.position[k]
        shape[i, 3 + k] = splat.scale[k]
        shape[i, 11 + k] = dc[k]
    for k in range(4):
        shape[i, 6 + k] = q[k]
    shape[i, 10] = splat.opacity
    for k in range(cloud.rest_count):
        rest[i, k] = read_rest(cloud, i, k)


@wp.kernel
def boxes_kernel(
    cloud: DeviceCloud, alpha_min: wp.float32, low: wp.array(dtype=wp.vec3), high: wp.array(dtype=wp.vec3)
) -> None:
    box = group_box(cloud.groups, wp.tid(), alpha_min)
    low[wp.tid()] = box.low
    high[wp.tid()] = box.high


def read_back(cloud: DeviceCloud, device: Any) -> ReadBack:
    shape = wp.zeros((cloud.splat_count, 14), dtype=wp.float32, device=device)
    rest = wp.zeros((cloud.splat_count, max(cloud.rest_count, 1)), dtype=wp.vec3, device=device)
    wp.launch(read_back_kernel, dim=cloud.splat_count, inputs=[cloud, shape, rest], device=device)
    values, coefficients = shape.numpy(), rest.numpy()[:, : cloud.rest_count]
    place = np.flatnonzero(values[:, 10] > 0)
    values, coefficients = values[place], coefficients[place]
    return ReadBack(
        place, values[:, :3], values[:, 3:6], values[:, 6:10], values[:, 10], values[:, 11:14], coefficients
    )


def boxes(cloud: DeviceCloud, alpha_min: float, device: Any) -> tuple[FloatArray, FloatArray]:
    """Low and high corners (G, 3) of the groups' boxes."""
    low, high = (wp.empty(cloud.groups.count, dtype=wp.vec3, device=device) for _ in range(2))
    wp.launch(boxes_kernel, dim=cloud.groups.count, inputs=[cloud, alpha_min, low, high], device=device)
    return low.numpy(), high.numpy()
