# SPDX-License-Identifier: GPL-3.0-or-later
"""What a transform changed: the map, which splats, and how far the map back misses each old value."""

from __future__ import annotations

from dataclasses import dataclass

import warp as wp

from ..buffers import allocate
from ..device import map_on_threads
from .affine import Matrix
from .editable_cloud import EditableCloud
from .lossless import Distances, deflate, inflate, join, split
from .mask import EDIT_LESS, Mask
from .paint_layer import show_harmonics
from .rows import Arrays, as_columns, no_rows, scratch_rows
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
        self._show(cloud, rows)

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
        self._show(cloud, rows)

    def _map(self, cloud: EditableCloud) -> SplatMap:
        return SplatMap(self.matrix, cloud.sh_degree, cloud.device)

    def _show(self, cloud: EditableCloud, rows: wp.array) -> None:
        cloud.touched(*self.parts)
        if "base_rest" in self.parts:
            show_harmonics(cloud, rows)


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
