# SPDX-License-Identifier: GPL-3.0-or-later
"""Rows of a cloud's arrays by a list of splats: copied out, copied in."""

from __future__ import annotations

import math

import warp as wp

from ..buffers import allocate
from ..device import launch
from .mask import EDIT_LESS

wp.set_module_options({"enable_backward": False})

Arrays = dict[str, wp.array]


@wp.func
def row_of(rows: wp.array(dtype=wp.int32), i: wp.int32) -> wp.int32:
    """Row of element i; an empty list stands for all rows in order."""
    if rows.shape[0] == 0:
        return i
    return rows[i]


@wp.kernel
def copy_rows_kernel(
    first: wp.int32,
    from_rows: wp.array(dtype=wp.int32),
    source: wp.array2d(dtype=wp.uint32),
    to_rows: wp.array(dtype=wp.int32),
    target: wp.array2d(dtype=wp.uint32),
) -> None:
    i = first + wp.tid()
    row = row_of(from_rows, i)
    to = row_of(to_rows, i)
    for k in range(wp.min(source.shape[1], target.shape[1])):
        target[to, k] = source[row, k]


def copy_rows(count: int, from_rows: wp.array, old: Arrays, to_rows: wp.array, new: Arrays) -> None:
    """Copy `count` rows of every attribute of `old` to `new`, the columns both have; see `row_of` for the lists."""
    for name, array in old.items():
        columns = as_columns(array)
        if columns.shape[1]:
            launch(copy_rows_kernel, count, [from_rows, columns, to_rows, as_columns(new[name])], array.device)


def as_columns(array: wp.array) -> wp.array:
    """The same memory as (rows, 4-byte columns per row), as uint32 whatever it holds."""
    columns = wp.types.type_size_in_bytes(array.dtype) // 4 * math.prod(array.shape[1:])
    view = wp.array(ptr=array.ptr, dtype=wp.uint32, shape=(array.shape[0], columns), device=array.device, copy=False)
    view._ref = array  # the memory lives as long as the view
    return view


def no_rows(device: wp.Device) -> wp.array:
    """The list that stands for all rows in order."""
    return wp.empty(0, dtype=wp.int32, device=device)


def scratch_rows(like: Arrays, count: int, device: wp.Device, what: str) -> Arrays:
    """Uninitialised arrays of `count` splats with the attributes of `like`. Raises StippleError for memory."""
    return {
        name: allocate(device, array.dtype, (count, *array.shape[1:]), what, EDIT_LESS) for name, array in like.items()
    }
