# SPDX-License-Identifier: GPL-3.0-or-later
"""Many copies of a capture side by side: a large scene with the statistics of a real one, harmonics included.

The capture is quantised once. A splat's packed place is relative to its group, so copies share every byte of their
splats and differ in the ranges and bounds of their groups only.
"""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt
import warp as wp

from stipple.engine.cloud_upload import Progress
from stipple.engine.device import launch
from stipple.engine.device_cloud import DeviceCloud, empty_cloud
from stipple.engine.groups import SplatGroups, shift_for
from stipple.engine.quantise import quantise, quantising_bytes_per_splat
from stipple.engine.splats import SplatCloud, packed_bytes_per_splat

wp.set_module_options({"enable_backward": False})

PADDING = 1.1  # for splats that fill up groups, and for the groups; more than is ever needed
APART = 0.85  # distance of neighbours in units of the capture's width
ROUNDING = wp.constant(4e-7)  # of single-precision sums, of their largest term
PER_SPLAT = ("packed_geometry", "packed_opacity", "packed_colour", "sh_dc", "rest_largest", "packed_rest")
PER_GROUP = ("sigma", "opacity", "packed_span", "packed_log_scale", "packed_brightest")


@wp.kernel
def displace_groups_kernel(
    first: wp.int32, one: SplatGroups, displacement: wp.array(dtype=wp.vec3), groups: SplatGroups
) -> None:
    group = first + wp.tid()
    copy = group / one.count
    source = group - copy * one.count
    d = displacement[copy]
    groups.packed_low[group] = one.packed_low[source] + d
    slack = ROUNDING * (wp.abs(d) + wp.max(wp.abs(one.low[source]), wp.abs(one.high[source])))
    groups.low[group] = one.low[source] + d - slack
    groups.high[group] = one.high[source] + d + slack


class DisplacedCopies:
    """At least `splat_count` splats from whole copies of a capture, a `DeviceSource`.

    Copies stand on a square grid in the plane of x and z, in Morton order, a little higher and lower by turns.
    """

    def __init__(self, capture: SplatCloud, splat_count: int) -> None:
        self.capture = capture
        self.copy_count = -(-splat_count // capture.splat_count)
        self.splat_count = self.copy_count * capture.splat_count
        self.sh_degree = capture.sh_degree
        self.name = f"{self.copy_count} × {capture.name}"

    @property
    def nbytes(self) -> int:
        one = self.capture.splat_count * quantising_bytes_per_splat(self.sh_degree)
        return int(self.splat_count * packed_bytes_per_splat(self.sh_degree) * PADDING) + one

    @property
    def spacing(self) -> float:
        """Between the middles of neighbours [object units]; outliers of the capture do not count."""
        low, high = np.percentile(self.capture.position[:, [0, 2]], (2, 98), axis=0)
        return APART * float((high - low).max())

    @cached_property
    def displacements(self) -> npt.NDArray[np.float64]:
        """(copies, 3) of each copy; the first ones are nearest to the origin's cell in Morton order."""
        number = np.arange(self.copy_count)
        column, row = (_every_other_bit(number >> axis) for axis in (0, 1))
        height = 0.04 * np.sin(2.4 * number)
        return np.stack([column, height, row], axis=1) * self.spacing

    @cached_property
    def bounds(self) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
        low, high = self.capture.bounds
        return low + self.displacements.min(axis=0), high + self.displacements.max(axis=0)

    def upload(self, device: wp.Device, progress: Progress) -> DeviceCloud:
        progress(0.0, f"building {self.name}")
        capture = self.capture
        one = quantise(
            lambda _arrays: [capture],
            capture.splat_count,
            self.sh_degree,
            capture.name,
            device,
            group_shift=shift_for(self.splat_count),
        )
        copies = self.copy_count
        cloud = empty_cloud(one.splat_count * copies, self.sh_degree)
        cloud.is_quantised = 1
        for name in PER_SPLAT:
            _repeat(one, cloud, name, copies)
        groups = SplatGroups()
        groups.shift, groups.count = one.groups.shift, one.groups.count * copies
        for name in PER_GROUP:
            _repeat(one.groups, groups, name, copies)
        for name in ("low", "high", "packed_low"):
            setattr(groups, name, wp.empty(groups.count, dtype=wp.vec3, device=device))
        displacement = wp.array(self.displacements, dtype=wp.vec3, device=device)
        launch(displace_groups_kernel, groups.count, [one.groups, displacement, groups], device)
        cloud.groups = groups
        return cloud


def _every_other_bit(number: npt.NDArray[np.int64]) -> npt.NDArray[np.int64]:
    """Bits 0, 2, 4, … of each number, moved together."""
    result = np.zeros_like(number)
    for bit in range(16):
        result |= ((number >> (2 * bit)) & 1) << bit
    return result


def _repeat(source: Any, target: Any, name: str, copies: int) -> None:
    """The array that is member `name` of a struct, copy after copy; what is not allocated stays so."""
    array = getattr(source, name)
    if array is None or array.size == 0:
        return
    result = wp.empty(array.size * copies, dtype=array.dtype, device=array.device)
    for copy in range(copies):
        wp.copy(result, array, dest_offset=copy * array.size, count=array.size)
    setattr(target, name, result)
