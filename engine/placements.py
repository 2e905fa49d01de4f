# SPDX-License-Identifier: GPL-3.0-or-later
"""All instances of a scene on the device, and a number for every splat and every group of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import warp as wp

from .device_cloud import DeviceCloud
from .maths.projection import Pose

wp.set_module_options({"enable_backward": False})


@wp.struct
class Placed:
    """Instances, one after the other. Arrays that begin with `first_` have one entry more, the total."""

    count: wp.int32
    cloud: wp.array(dtype=DeviceCloud)
    pose: wp.array(dtype=Pose)
    first_splat: wp.array(dtype=wp.int64)  # number of each instance's first splat
    first_group: wp.array(dtype=wp.int64)


@dataclass(frozen=True, eq=False)
class Placements:
    """Instances on the device. `held` keeps alive what the arrays of structs point to."""

    placed: Placed
    instance_count: int
    splat_count: int
    group_count: int
    group_shift: int  # of the largest groups
    held: tuple[DeviceCloud, ...]


@wp.func
def instance_of(first: wp.array(dtype=wp.int64), count: wp.int32, number: wp.int64) -> wp.int32:
    """The instance that a splat's or group's number belongs to: the last that begins at or before it."""
    low = int(0)
    high = count
    while high - low > 1:
        middle = (low + high) / 2
        if first[middle] <= number:
            low = middle
        else:
            high = middle
    return low


def place(clouds: Sequence[DeviceCloud], poses: Sequence[Pose], device: wp.Device) -> Placements:
    """Numbers run through the instances in their order, through each cloud as it lies on the device."""
    splats = np.concatenate([[0], np.cumsum([cloud.splat_count for cloud in clouds], dtype=np.int64)])
    groups = np.concatenate([[0], np.cumsum([cloud.groups.count for cloud in clouds], dtype=np.int64)])
    placed = Placed()
    placed.count = len(clouds)
    if clouds:
        placed.cloud = wp.array(list(clouds), dtype=DeviceCloud, device=device)
        placed.pose = wp.array(list(poses), dtype=Pose, device=device)
    placed.first_splat = wp.array(splats, dtype=wp.int64, device=device)
    placed.first_group = wp.array(groups, dtype=wp.int64, device=device)
    shift = max((cloud.groups.shift for cloud in clouds), default=0)
    return Placements(placed, len(clouds), int(splats[-1]), int(groups[-1]), shift, tuple(clouds))
