# SPDX-License-Identifier: GPL-3.0-or-later
"""What a transform changed: the map, which splats, and how far the map back misses each old value."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

import warp as wp

from ..buffers import allocate
from ..device import map_on_threads
from .affine import Matrix
from .editable_cloud import EditableCloud
from .lossless import Distances, deflate, inflate, join, split
from .mask import EDIT_LESS, Mask
from .paint_layer import show_harmonics
from .rows import Arrays, as_columns, copy_rows, no_rows, scratch_rows
from .transform_kernels import SplatMap

BLOCK = 1 << 14  # splats whose distances are deflated together
ROUND = 8  # blocks that are deflated or inflated at a time, so that all threads have work


@dataclass(frozen=True, eq=False)
class TransformDiff:
    """An affine map of a set of splats that can be reverted to the last bit.

    Reverting applies the inverse map and adds the kept distances (`lossless.py`); applying again recomputes, which
    gives the same bits as the first time on the same device.
    """

    matrix: Matrix  # (3, 4), new from old in object space
    which: Mask
    parts: tuple[str, ...]
    blocks: tuple[tuple[Distances, ...], ...]  # per block of BLOCK splats, per attribute of `parts`

    @property
    def nbytes(self) -> int:
        return self.which.nbytes + self.matrix.nbytes + sum(part.nbytes for block in self.blocks for part in block)

    def apply(self, cloud: EditableCloud) -> None:
        rows, forward = self.which.indices(), self._map(cloud)
        arrays = {name: cloud.writable(name) for name in self.parts}
        forward.run(rows.size, rows, arrays, rows, arrays)
        show_mapped(cloud, self.parts, rows)

    def revert(self, cloud: EditableCloud) -> None:
        rows, forward = self.which.indices(), self._map(cloud)
        backward = forward.inverse()
        arrays = {name: cloud.writable(name) for name in self.parts}
        predicted = scratch_rows(arrays, min(BLOCK, rows.size), cloud.device, "undoing a transform")
        done = 0
        try:
            for at in range(0, len(self.blocks), ROUND):
                planes = map_on_threads(inflate, [part for block in self.blocks[at : at + ROUND] for part in block])
                while planes:
                    some = rows[done : min(done + BLOCK, rows.size)]
                    into = {name: array[: some.size] for name, array in predicted.items()}
                    backward.run(some.size, some, arrays, no_rows(cloud.device), into)
                    for name in self.parts:
                        join(some, arrays[name], into[name], planes.pop(0))
                    done += some.size
        except BaseException:
            forward.run(done, rows[:done], arrays, rows[:done], arrays)
            raise
        show_mapped(cloud, self.parts, rows)

    def _map(self, cloud: EditableCloud) -> SplatMap:
        return SplatMap(self.matrix, cloud.sh_degree, cloud.device)


@dataclass(frozen=True, eq=False)
class KeptDiff:
    """An affine map of a set of splats, and the old values as they are.

    Takes 220 bytes a turned splat of degree 3 where `TransformDiff` takes 14, and a third of the time: for hosts that
    have an undo of their own and revert only what they could not write.
    """

    forward: SplatMap
    which: Mask
    old: Arrays  # a row for each splat of `which`, in order

    @property
    def matrix(self) -> Matrix:
        """(3, 4), new from old in object space."""
        return self.forward.matrix

    @property
    def nbytes(self) -> int:
        return self.which.nbytes + self.matrix.nbytes + sum(array.capacity for array in self.old.values())

    def apply(self, cloud: EditableCloud) -> None:
        rows = self.which.indices()
        arrays = {name: cloud.writable(name) for name in self.forward.parts}
        self.forward.run(rows.size, no_rows(cloud.device), self.old, rows, arrays)
        show_mapped(cloud, self.forward.parts, rows)

    def revert(self, cloud: EditableCloud) -> None:
        rows = self.which.indices()
        arrays = {name: cloud.writable(name) for name in self.forward.parts}
        kept = {name: self.old[name] for name in self.forward.parts}
        copy_rows(rows.size, no_rows(cloud.device), kept, rows, arrays)
        show_mapped(cloud, self.forward.parts, rows)


def show_mapped(cloud: EditableCloud, parts: Collection[str], rows: wp.array) -> None:
    """Some attributes of the splats `rows` were mapped: say so, and let painted harmonics follow."""
    cloud.touched(*parts)
    if "base_rest" in parts:
        show_harmonics(cloud, rows)


def kept_diff(cloud: EditableCloud, forward: SplatMap, which: Mask) -> KeptDiff:
    """The diff of mapping the splats `which`. Changes nothing. Raises StippleError when memory runs out."""
    rows = which.indices()
    arrays = {name: cloud.array(name) for name in forward.parts}
    old = scratch_rows(arrays, rows.size, cloud.device, "a transform")
    copy_rows(rows.size, rows, arrays, no_rows(cloud.device), old)
    return KeptDiff(forward, which, old)


def transform_diff(
    cloud: EditableCloud, forward: SplatMap, which: Mask, old: Arrays, old_rows: wp.array
) -> TransformDiff:
    """The diff of mapping the splats `which`, whose old values are rows `old_rows` of `old`. Changes nothing.

    An empty `old_rows` stands for all rows of `old` in order. Raises StippleError when memory runs out.
    """
    backward, everything = forward.inverse(), no_rows(cloud.device)
    count = which.count()
    size = min(BLOCK, count)
    new, predicted = (scratch_rows(old, size, cloud.device, "a transform") for _ in range(2))
    widest = max(as_columns(array).shape[1] for array in new.values())
    planes = allocate(cloud.device, wp.uint8, 4 * widest * size, "the undo of a transform", EDIT_LESS)
    blocks: list[tuple[Distances, ...]] = []
    pending = []
    for first in range(0, count, BLOCK):
        some = min(BLOCK, count - first)
        into = {name: array[:some] for name, array in new.items()}
        back = {name: array[:some] for name, array in predicted.items()}
        if old_rows.size:
            rows, source = old_rows[first : first + some], old
        else:
            rows, source = everything, {name: array[first : first + some] for name, array in old.items()}
        forward.run(some, rows, source, everything, into)
        backward.run(some, everything, into, everything, back)
        pending += [split(rows, source[name], back[name], planes) for name in forward.parts]
        if len(pending) >= ROUND * len(forward.parts) or first + some == count:
            parts = deflate(pending)
            width = len(forward.parts)
            blocks += [tuple(parts[at : at + width]) for at in range(0, len(parts), width)]
            pending = []
    return TransformDiff(forward.matrix, which, forward.parts, tuple(blocks))
