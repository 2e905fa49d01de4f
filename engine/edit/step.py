# SPDX-License-Identifier: GPL-3.0-or-later
"""A step: one operation as the differences it makes, computed before anything is changed."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import warp as wp

from ..device import launch
from .editable_cloud import EditableCloud
from .mask import Mask

wp.set_module_options({"enable_backward": False})

STEP_BYTES = 48  # what a step holds besides its masks and values: name, count, flag, references


class Diff(Protocol):
    """One difference. `revert` after `apply` restores every bit of every array; both may then be repeated in turn.

    Neither may leave a cloud half changed: what can fail (memory) comes before the first write.
    """

    @property
    def nbytes(self) -> int:
        """Memory it keeps [bytes]."""
        ...

    def apply(self, cloud: EditableCloud) -> None: ...

    def revert(self, cloud: EditableCloud) -> None: ...


@dataclass(frozen=True, eq=False)
class Step:
    """A named operation: its diffs are applied in order and reverted in reverse order.

    `changed` is how many splats it concerns: a host tells the user, and `History` records no step that changes none.
    """

    name: str
    diffs: tuple[Diff, ...]
    changed: int

    @property
    def nbytes(self) -> int:
        return STEP_BYTES + sum(diff.nbytes for diff in self.diffs)

    def apply(self, cloud: EditableCloud) -> None:
        """Do it. Where a diff fails, those before it are reverted and the error goes on."""
        done: list[Diff] = []
        try:
            for diff in self.diffs:
                diff.apply(cloud)
                done.append(diff)
        except BaseException:
            for diff in reversed(done):
                diff.revert(cloud)
            raise

    def revert(self, cloud: EditableCloud) -> None:
        """Undo it. Where a diff fails, those after it are applied again and the error goes on."""
        undone: list[Diff] = []
        try:
            for diff in reversed(self.diffs):
                diff.revert(cloud)
                undone.append(diff)
        except BaseException:
            for diff in reversed(undone):
                diff.apply(cloud)
            raise


@wp.kernel
def flip_flag_kernel(
    first: wp.int32, changed: wp.array(dtype=wp.uint32), flag: wp.uint32, state: wp.array(dtype=wp.uint32)
) -> None:
    w = first + wp.tid()
    bits = changed[w]
    if bits != wp.uint32(0):
        for k in range(32):
            if (bits >> wp.uint32(k)) & wp.uint32(1) != wp.uint32(0):
                state[32 * w + k] = state[32 * w + k] ^ flag


@dataclass(frozen=True, eq=False)
class FlagDiff:
    """One flag flipped for a set of splats: one bit per splat, its own inverse."""

    flag: int
    flipped: Mask

    @property
    def nbytes(self) -> int:
        return self.flipped.nbytes

    def apply(self, cloud: EditableCloud) -> None:
        launch(flip_flag_kernel, self.flipped.words.size, [self.flipped.words, self.flag, cloud.state], cloud.device)
        cloud.touched("state")

    revert = apply


def flag_step(name: str, flag: int, flipped: Mask) -> Step:
    """The step that flips `flag` for a set of splats."""
    return Step(name, (FlagDiff(flag, flipped),), flipped.count())
