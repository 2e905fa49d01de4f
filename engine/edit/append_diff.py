# SPDX-License-Identifier: GPL-3.0-or-later
"""Splats added at the end of a cloud: copies of its own, or another capture's."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import warp as wp

from ..buffers import allocate
from ..device import launch
from ..splats import SH_REST_COUNT, SplatCloud
from .affine import Matrix
from .editable_cloud import EditableCloud
from .mask import EDIT_LESS, Mask
from .paint_layer import show_harmonics
from .rows import as_columns, copy_rows, no_rows
from .state import SELECTED
from .transform_kernels import SplatMap

wp.set_module_options({"enable_backward": False})


@wp.kernel
def number_rows_kernel(first: wp.int32, begin: wp.int32, rows: wp.array(dtype=wp.int32)) -> None:
    i = first + wp.tid()
    rows[i] = begin + i


@wp.kernel
def set_state_kernel(first: wp.int32, begin: wp.int32, value: wp.uint32, state: wp.array(dtype=wp.uint32)) -> None:
    state[begin + first + wp.tid()] = value


@dataclass(frozen=True, eq=False)
class CopyDiff:
    """Copies of some of a cloud's splats, mapped by a matrix, selected.

    Keeps one bit per splat: what is copied still stands in the cloud when it is done again.
    """

    matrix: Matrix  # (3, 4), copy from original in object space
    which: Mask

    @property
    def nbytes(self) -> int:
        return self.which.nbytes + self.matrix.nbytes

    def apply(self, cloud: EditableCloud) -> None:
        sources, begin = self.which.indices(), cloud.splat_count
        forward = SplatMap(self.matrix, cloud.sh_degree, cloud.device)
        for name in forward.parts:
            cloud.array(name)  # refuses here what was not loaded
        rows = numbered_rows(begin, sources.size, cloud.device)
        cloud.grow(sources.size)
        arrays = {name: cloud.array(name) for name in cloud.attribute_names}
        copy_rows(sources.size, sources, arrays, rows, arrays)
        mapped = {name: cloud.array(name) for name in forward.parts}
        forward.run(sources.size, sources, mapped, rows, mapped)
        if "base_rest" in forward.parts:
            show_harmonics(cloud, rows)
        launch(set_state_kernel, sources.size, [begin, SELECTED, cloud.state], cloud.device)
        cloud.touched(*cloud.attribute_names)

    def revert(self, cloud: EditableCloud) -> None:
        cloud.shrink(self.which.count())
        cloud.touched(*cloud.attribute_names)


@dataclass(frozen=True, eq=False)
class AppendDiff:
    """Another capture's splats, selected.

    Raises the cloud's SH degree where the other's is higher, and pads the other's where it is lower, with zeros.
    """

    other: SplatCloud
    rest_count: int  # the cloud's before

    @property
    def nbytes(self) -> int:
        return self.other.nbytes

    def apply(self, cloud: EditableCloud) -> None:
        begin, count, degree = cloud.splat_count, self.other.splat_count, max(cloud.sh_degree, self.other.sh_degree)
        values: dict[str, npt.NDArray[np.float32]] = {
            name: getattr(self.other, name) for name in ("position", "scale", "rotation", "opacity", "sh_dc")
        }
        values["sh_rest"] = padded_rest(self.other.sh_rest, degree)
        uploads = EditableCloud(values, cloud.device, self.other.name)
        rows = numbered_rows(begin, count, cloud.device)
        cloud.grow(count, SH_REST_COUNT[degree])
        for name in cloud.attribute_names:
            source = {"base_dc": "sh_dc", "base_rest": "sh_rest", "base_opacity": "opacity"}.get(name, name)
            if name == "paint":
                as_zeros = as_columns(cloud.array(name)[begin:])
                as_zeros.zero_()
            elif source != "state":
                copy_rows(count, no_rows(cloud.device), {name: uploads.array(source)}, rows, {name: cloud.array(name)})
        launch(set_state_kernel, count, [begin, SELECTED, cloud.state], cloud.device)
        cloud.touched(*cloud.attribute_names)

    def revert(self, cloud: EditableCloud) -> None:
        cloud.shrink(self.other.splat_count, self.rest_count)
        cloud.touched(*cloud.attribute_names)


def numbered_rows(begin: int, count: int, device: wp.Device) -> wp.array:
    """The list begin, begin + 1, …"""
    rows = allocate(device, wp.int32, count, "more splats", EDIT_LESS)
    launch(number_rows_kernel, count, [begin, rows], device)
    return rows


def padded_rest(sh_rest: npt.NDArray[np.float32], degree: int) -> npt.NDArray[np.float32]:
    """Coefficients (N, C, 3) with zeros up to those of `degree`."""
    missing = SH_REST_COUNT[degree] - sh_rest.shape[1]
    return np.ascontiguousarray(np.pad(sh_rest, ((0, 0), (0, missing), (0, 0)))) if missing else sh_rest
