# SPDX-License-Identifier: GPL-3.0-or-later
"""Keep old values exactly, in few bytes, where new values nearly tell them.

Each old float is kept as its distance, in steps of the float's own grid, from a prediction: after a transform, from
what the inverse transform makes of the new value. Predictions are off by a few steps of rounding, so of a distance's
four bytes the upper three are almost always 0. The bytes are sorted by significance (all lowest bytes, then all
second ones, …) and deflated. Any prediction restores the old bits, a bad one only compresses less.

This answers what Splatshop leaves open (doi 10.1111/cgf.70214, §5, "Lossless Undo/Redo of Transformations").
"""

from __future__ import annotations

import zlib
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import warp as wp

from ..device import launch, map_on_threads
from .rows import as_columns, row_of

wp.set_module_options({"enable_backward": False})

Bytes = npt.NDArray[np.uint8]
SIGN = wp.constant(wp.uint32(0x80000000))
LEVEL, STRATEGY = 1, zlib.Z_RLE  # runs of zeros and short codes are all there is to find


@wp.func
def ordered(bits: wp.uint32) -> wp.uint32:
    """Bits of a float as an integer that counts the floats in order."""
    if (bits >> wp.uint32(31)) != wp.uint32(0):
        return ~bits
    return bits | SIGN


@wp.func
def bits_at(order: wp.uint32) -> wp.uint32:
    """Bits of the float that `ordered` counts as `order`."""
    if (order >> wp.uint32(31)) != wp.uint32(0):
        return order & wp.uint32(0x7FFFFFFF)
    return ~order


@wp.kernel
def split_distances_kernel(
    first: wp.int32,
    rows: wp.array(dtype=wp.int32),
    values: wp.array2d(dtype=wp.uint32),
    predicted: wp.array2d(dtype=wp.uint32),  # row i for values' row rows[i]
    planes: wp.array3d(dtype=wp.uint8),  # significance, column, i
) -> None:
    i = first + wp.tid()
    row = row_of(rows, i)
    for k in range(values.shape[1]):
        d = ordered(values[row, k]) - ordered(predicted[i, k])
        # Small distances of either sign become small numbers: 0, -1, 1, -2, … → 0, 1, 2, 3, …
        d = (d << wp.uint32(1)) ^ (wp.uint32(0) - (d >> wp.uint32(31)))
        for b in range(4):
            planes[b, k, i] = wp.uint8((d >> wp.uint32(8 * b)) & wp.uint32(255))


@wp.kernel
def join_distances_kernel(
    first: wp.int32,
    rows: wp.array(dtype=wp.int32),
    values: wp.array2d(dtype=wp.uint32),
    predicted: wp.array2d(dtype=wp.uint32),
    planes: wp.array3d(dtype=wp.uint8),
) -> None:
    i = first + wp.tid()
    row = rows[i]
    for k in range(values.shape[1]):
        d = wp.uint32(0)
        for b in range(4):
            d |= wp.uint32(planes[b, k, i]) << wp.uint32(8 * b)
        d = (d >> wp.uint32(1)) ^ (wp.uint32(0) - (d & wp.uint32(1)))
        values[row, k] = bits_at(ordered(predicted[i, k]) + d)


@dataclass(frozen=True, eq=False)
class Distances:
    """Deflated distances of some rows of one attribute: four streams, None for one of zeros only."""

    columns: int
    rows: int
    streams: tuple[bytes | None, ...]

    @property
    def nbytes(self) -> int:
        return sum(len(stream) for stream in self.streams if stream is not None)


def split(rows: wp.array, values: wp.array, predicted: wp.array, planes: wp.array) -> Bytes:
    """Distances of rows of `values` from rows 0 … of `predicted`, (4, columns, rows) bytes on the host.

    `planes` is scratch of that shape or larger, uint8 and flat. An empty `rows` stands for all rows in order.
    """
    columns = as_columns(values)
    count = predicted.shape[0]
    shaped = planes[: 4 * columns.shape[1] * count].reshape((4, columns.shape[1], count))
    launch(split_distances_kernel, count, [rows, columns, as_columns(predicted), shaped], values.device)
    return shaped.numpy().copy() if shaped.device.is_cpu else shaped.numpy()


def join(rows: wp.array, values: wp.array, predicted: wp.array, planes: Bytes) -> None:
    """Write rows of `values`: what `split` was given, from the same prediction."""
    device = values.device
    on_device = wp.array(planes, dtype=wp.uint8, device=device)
    launch(join_distances_kernel, rows.size, [rows, as_columns(values), as_columns(predicted), on_device], device)


def deflate(parts: list[Bytes]) -> list[Distances]:
    """Compress the planes of several blocks, on all threads."""
    streams = map_on_threads(_deflated, [plane for part in parts for plane in part])
    return [
        Distances(part.shape[1], part.shape[2], tuple(streams[4 * index : 4 * index + 4]))
        for index, part in enumerate(parts)
    ]


def inflate(part: Distances) -> Bytes:
    """The planes of one block."""
    planes = np.zeros((4, part.columns, part.rows), np.uint8)
    for plane, stream in zip(planes, part.streams, strict=True):
        if stream is not None:
            plane.reshape(-1)[:] = np.frombuffer(zlib.decompress(stream), np.uint8)
    return planes


def _deflated(plane: Bytes) -> bytes | None:
    if not plane.any():
        return None
    packer = zlib.compressobj(LEVEL, zlib.DEFLATED, 15, 9, STRATEGY)
    return packer.compress(plane) + packer.flush()
