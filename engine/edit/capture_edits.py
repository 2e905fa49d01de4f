# SPDX-License-Identifier: GPL-3.0-or-later
"""What an edit has made of a capture that stays in its file: plain arrays, small beside the capture. No device.

Splats are counted as the file has them, those that cannot be rendered left out; so the numbers mean the same on every
device, and in a copy of the file. What is kept says how a splat differs from the file's, never what it is:

| arrays                            | of each                                                            |
|-----------------------------------|--------------------------------------------------------------------|
| `selected`, `hidden`, …           | splat: one bit, the lowest of a byte first; only of flags in use   |
| `painted_rows`, `painted_words`   | painted splat: its number, its paint word (`paint_word`)           |
| `opacity_rows`, `opacity_values`  | splat of a painted opacity: its number, the opacity                |
| `moved_rows`, `moved_by`          | transformed splat: its number, which of `matrices` it went through |
| `matrices`                        | (T, 3, 4) float64, new from old in object space                    |

A transform after a transform keeps the product, in float64: the splat itself is rounded once, whatever was done to it.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from ..capture_fingerprint import Fingerprint
from ..errors import StippleError
from .state_bits import DELETED, HIDDEN, LOCKED, SELECTED, SEPARATED

Array = npt.NDArray[Any]
Rows = npt.NDArray[np.int32]

BITS_OF_BYTE = np.unpackbits(np.arange(256, dtype=np.uint8)[:, None], axis=1).sum(axis=1, dtype=np.uint8)
FLAGS = {"selected": SELECTED, "hidden": HIDDEN, "deleted": DELETED, "locked": LOCKED, "separated": SEPARATED}
VALUES = {"painted_rows": "painted_words", "opacity_rows": "opacity_values", "moved_rows": "moved_by"}
DTYPES: dict[str, type[np.generic]] = {
    **dict.fromkeys(FLAGS, np.uint8),
    "painted_rows": np.int32,
    "painted_words": np.uint64,
    "opacity_rows": np.int32,
    "opacity_values": np.float32,
    "moved_rows": np.int32,
    "moved_by": np.int32,
    "matrices": np.float64,
}


def identity_of(fingerprint: Fingerprint) -> str:
    """What edits know a capture by: its size and content, not its date, which a copy may change."""
    return f"{fingerprint.file_bytes} {fingerprint.samples}"


def check_edits_of(path: Path, fingerprint: Fingerprint, edits: CaptureEdits) -> None:
    """Raises StippleError unless the edits are of the capture's file as it was opened."""
    if edits.capture != identity_of(fingerprint):
        raise StippleError(
            f"{path}: the edits were made on a file of other content; put that file back, or discard the edits."
        )


@dataclass(frozen=True, eq=False)
class CaptureEdits:
    """The edits of one capture: an immutable value; arrays are shared between one state of an edit and the next.

    - `capture`: its `identity_of`.
    - `splat_count`: of its splats that can be rendered.
    - `arrays`: see the table above; what holds nothing is missing.

    Raises StippleError, which says what is wrong with the edits, where the arrays do not fit together.
    """

    capture: str
    splat_count: int
    arrays: Mapping[str, Array] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for name, array in self.arrays.items():
            if DTYPES.get(name) != array.dtype.type:
                raise StippleError(f"the edits have an array {name!r} of {array.dtype}, which is none of theirs.")
        for name in FLAGS.keys() & self.arrays.keys():
            if self.arrays[name].shape != (-(-self.splat_count // 8),):
                raise StippleError(f"the edits' {name!r} is not of {self.splat_count:,} splats.")
        for rows, values in VALUES.items():
            self._check_rows(rows, values)
        matrices = self.matrices
        if matrices.shape[1:] != (3, 4) or not np.isfinite(matrices).all():
            raise StippleError("the edits' 'matrices' are not finite 3×4 matrices.")
        moved_by = self.get("moved_by")
        if moved_by.size and (moved_by.min() < 0 or moved_by.max() >= len(matrices)):
            raise StippleError("the edits' 'moved_by' names matrices that are not there.")

    def _check_rows(self, rows_name: str, values_name: str) -> None:
        rows, values = self.get(rows_name), self.get(values_name)
        if rows.ndim != 1 or rows.shape != values.shape:
            raise StippleError(f"the edits' {rows_name!r} and {values_name!r} are not of one length.")
        if rows.size and (rows[0] < 0 or rows[-1] >= self.splat_count or (np.diff(rows) <= 0).any()):
            raise StippleError(f"the edits' {rows_name!r} are not rising numbers below {self.splat_count:,}.")

    def get(self, name: str) -> Array:
        """An array; an empty one where there is none."""
        array = self.arrays.get(name)
        return np.empty(0, DTYPES[name]) if array is None else array

    @property
    def matrices(self) -> npt.NDArray[np.float64]:
        return self.arrays.get("matrices", np.empty((0, 3, 4)))

    @property
    def is_empty(self) -> bool:
        return not self.arrays

    @property
    def nbytes(self) -> int:
        return sum(array.nbytes for array in self.arrays.values())

    @cached_property
    def token(self) -> str:
        """A hash of everything here: equal tokens mean equal edits of equal captures."""
        digest = hashlib.blake2b(f"{self.capture} {self.splat_count}".encode(), digest_size=16)
        for name in sorted(self.arrays):
            array = self.arrays[name]
            digest.update(f"{name} {array.dtype.str} {array.shape}".encode())
            digest.update(np.ascontiguousarray(array).data.cast("B"))
        return digest.hexdigest()

    @cached_property
    def changed_rows(self) -> Rows:
        """The splats whose values, flags apart, are not the file's; ascending."""
        rows = [self.get(name) for name in VALUES]
        if not any(part.size for part in rows):
            return np.empty(0, np.int32)
        changed = np.zeros(max(int(part[-1]) for part in rows if part.size) + 1, bool)
        for part in rows:
            changed[part] = True  # faster than to sort millions
        return np.flatnonzero(changed).astype(np.int32)

    @cached_property
    def counts(self) -> dict[str, int]:
        """How many splats have each flag: of `deleted` all, some of which are `separated`, and of others the rest.

        `selected` are only those that an operation would act on.
        """
        bits = {name: self.arrays.get(name, np.uint8(0)) for name in FLAGS}
        kept = ~bits["deleted"]
        shown = bits | {"hidden": bits["hidden"] & kept, "locked": bits["locked"] & kept}
        shown["selected"] = bits["selected"] & ~bits["hidden"] & ~bits["locked"] & kept
        return {name: _count(array) if name in self.arrays else 0 for name, array in shown.items()}

    def states(self) -> npt.NDArray[np.uint32]:
        """The flags of all splats (N,), bits as in `edit.state`."""
        states = np.zeros(self.splat_count, np.uint8)  # the flags there are fit, and a fourth of the memory is faster
        for name in FLAGS.keys() & self.arrays.keys():
            bits = np.unpackbits(self.arrays[name], count=self.splat_count, bitorder="little")
            states |= bits * np.uint8(FLAGS[name])
        return states.astype(np.uint32)

    def states_at(self, rows: npt.NDArray[np.int64]) -> npt.NDArray[np.uint32]:
        """The flags of some splats, without looking at the others."""
        states = np.zeros(len(rows), np.uint32)
        for name in FLAGS.keys() & self.arrays.keys():
            bits = (self.arrays[name][rows >> 3] >> (rows & 7).astype(np.uint8)) & np.uint8(1)
            states |= bits.astype(np.uint32) * np.uint32(FLAGS[name])
        return states

    def has_flag(self, name: str, begin: int, end: int) -> npt.NDArray[np.bool_]:
        """Which of the splats from `begin` to before `end` have a flag."""
        if name not in self.arrays:
            return np.zeros(end - begin, bool)
        part = np.unpackbits(self.arrays[name][begin // 8 : -(-end // 8)], bitorder="little")
        return part[begin % 8 : begin % 8 + end - begin].view(np.bool_)

    def values_of(self, rows_name: str, wanted: Rows) -> tuple[Rows, Array]:
        """Where in `wanted`, which rises, splats of `rows_name` stand, and their values."""
        rows, values = self.get(rows_name), self.get(VALUES[rows_name])
        low, high = np.searchsorted(rows, (wanted[0], wanted[-1] + 1)) if wanted.size else (0, 0)
        rows, values = rows[low:high], values[low:high]
        at = np.searchsorted(wanted, rows)
        found = wanted[np.minimum(at, max(wanted.size - 1, 0))] == rows if wanted.size else np.zeros(0, bool)
        return at[found].astype(np.int32), values[found]

    def with_states(self, states: npt.NDArray[np.uint32]) -> CaptureEdits:
        """The same with other flags (N,); those that stay share memory."""
        arrays = dict(self.arrays)
        for name, flag in FLAGS.items():
            bits = np.packbits((states & np.uint32(flag)) != 0, bitorder="little")
            _put(arrays, name, bits if bits.any() else None)
        return CaptureEdits(self.capture, self.splat_count, arrays)

    def with_values(self, rows_name: str, rows: Rows, values: Array, unchanged: Array) -> CaptureEdits:
        """The same with other values for some splats, which rise; `unchanged` (bool) are again as the file has them."""
        arrays, name = dict(self.arrays), VALUES[rows_name]
        kept = ~np.isin(self.get(rows_name), rows, assume_unique=True)
        new = ~unchanged
        all_rows = np.concatenate([self.get(rows_name)[kept], rows[new]]).astype(np.int32)
        all_values = np.concatenate([self.get(name)[kept], values[new]]).astype(DTYPES[name])
        order = np.argsort(all_rows)
        _put(arrays, rows_name, all_rows[order] if all_rows.size else None)
        _put(arrays, name, all_values[order] if all_rows.size else None)
        return CaptureEdits(self.capture, self.splat_count, arrays)

    def moved(self, rows: Rows, matrix: npt.NDArray[np.float64]) -> CaptureEdits:
        """The same after splats, which rise, went through a map (3, 4) of object space as well."""
        from .affine import composed  # imports Warp

        at, before = self.values_of("moved_rows", rows)
        now = np.full(rows.size, -1, np.int32)
        now[at] = before
        used, inverse = np.unique(now, return_inverse=True)
        new = np.array([matrix if k < 0 else composed(matrix, self.matrices[k]) for k in used])
        first = len(self.matrices)
        same = (new == np.eye(3, 4)).all(axis=(1, 2))
        arrays = {**self.arrays, "matrices": np.concatenate([self.matrices, new])}
        edits = CaptureEdits(self.capture, self.splat_count, arrays)
        return edits.with_values("moved_rows", rows, first + inverse, same[inverse])._without_spare_matrices()

    def _without_spare_matrices(self) -> CaptureEdits:
        arrays = dict(self.arrays)
        used, inverse = np.unique(self.get("moved_by"), return_inverse=True)
        _put(arrays, "moved_by", inverse.astype(np.int32) if used.size else None)
        _put(arrays, "matrices", self.matrices[used] if used.size else None)
        return CaptureEdits(self.capture, self.splat_count, arrays)


def _put(arrays: dict[str, Array], name: str, array: Array | None) -> None:
    """Replaces an array unless it is the same; None takes it out."""
    if array is None:
        arrays.pop(name, None)
    elif name not in arrays or not np.array_equal(arrays[name], array):
        arrays[name] = array


def _count(bits: npt.NDArray[np.uint8]) -> int:
    return int(BITS_OF_BYTE[bits].sum(dtype=np.int64))
