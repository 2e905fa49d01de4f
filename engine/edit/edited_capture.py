# SPDX-License-Identifier: GPL-3.0-or-later
"""A capture that stays in its file, as it looks with edits: two instances in the place of one.

The file's quantised splats are drawn under the edits' flags, and those whose values are edited are left out. These are
drawn from a cloud of their own in full precision, unpacked, transformed and painted. Both share one depth order, so
nothing shows the seam, and no kernel knows of paint or matrices.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from ..capture_file import CaptureFile
from ..progress import Progress
from ..scene import Instance, SplatStates
from ..splats import Bounds, full_bytes_per_splat
from .capture_edits import CaptureEdits, check_edits_of
from .state_bits import HIDDEN

if TYPE_CHECKING:
    import warp as wp

    from ..device_cloud import DeviceCloud


@dataclass(frozen=True, eq=False)
class EditedRows:
    """The splats of a capture whose values are edited, in full precision: a `DeviceSource`.

    `bounds` are the capture's, for where its splats have gone only the device tells.
    """

    capture: CaptureFile
    edits: CaptureEdits

    @property
    def name(self) -> str:
        return self.capture.name

    @property
    def splat_count(self) -> int:
        return int(self.edits.changed_rows.size)

    @property
    def sh_degree(self) -> int:
        return self.capture.sh_degree

    @property
    def nbytes(self) -> int:
        """With the copies that are made while they are painted [bytes]."""
        return 2 * self.splat_count * full_bytes_per_splat(self.sh_degree)

    @property
    def bounds(self) -> Bounds:
        return self.capture.bounds

    def upload(self, device: wp.Device, progress: Progress) -> DeviceCloud:
        """See `DeviceSource`."""
        from ..group_bounds import bound_groups
        from .capture_cloud import CaptureCloud, load_kernels

        load_kernels(device, progress)
        rows = CaptureCloud(self.capture, device, self.edits, progress, self.edits.changed_rows)
        cloud = rows.to_device_cloud()
        bound_groups(cloud, device)
        return cloud


class EditedCapture:
    """A capture and its edits; keeps what it has made of them, so that frames upload it once.

    Raises StippleError where the edits are of a file of other content.
    """

    def __init__(self, capture: CaptureFile, edits: CaptureEdits, rows: EditedRows | None = None) -> None:
        """`rows` are those of another state of the edit with the same values, which differs in flags only."""
        check_edits_of(capture.path, capture.fingerprint, edits)
        self.capture, self.edits = capture, edits
        changed = edits.changed_rows
        self.rows = (rows or EditedRows(capture, edits)) if changed.size else None
        self._states: dict[int, tuple[SplatStates | None, SplatStates | None]] = {}

    def instances(self, instance: Instance, seen: int) -> tuple[Instance, ...]:
        """What stands for an instance of the capture; `seen` are the flags that count, bits as in `edit.state`."""
        in_file, in_rows = self._states_of(seen)
        base = replace(instance, cloud=self.capture, states=in_file)
        if self.rows is None:
            return (base,)
        return base, replace(instance, cloud=self.rows, states=in_rows)

    def _states_of(self, seen: int) -> tuple[SplatStates | None, SplatStates | None]:
        if seen not in self._states:
            words, changed = self.edits.states() & np.uint32(seen), self.edits.changed_rows
            of_rows = words[changed]
            words[changed] = HIDDEN
            in_file, in_rows = (SplatStates(part) if part.any() else None for part in (words, of_rows))
            self._states[seen] = in_file, in_rows
        return self._states[seen]


def same_values(before: CaptureEdits, after: CaptureEdits) -> bool:
    """Whether two states of an edit differ in flags only, as far as their arrays are shared."""
    names = ("painted_rows", "painted_words", "opacity_rows", "opacity_values", "moved_rows", "moved_by", "matrices")
    return before.capture == after.capture and all(before.arrays.get(n) is after.arrays.get(n) for n in names)
