# SPDX-License-Identifier: GPL-3.0-or-later
"""Reading 3DGS captures from PLY files: one pass over the rows, activated in place, unusable splats left out."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from ..errors import StippleError
from ..splats import MIN_ROTATION_NORM, FloatArray, SplatCloud, degenerate_mask
from .ply_header import check_size, read_header, starts_like_ply
from .ply_layout import ROTATION, SCALE, properties_of_arrays, splat_element
from .ply_rows import Rows, read_rows
from .source_file import open_source
from .splat_format import AnyPath, LoadedSplats

__all__ = ["read_ply", "starts_like_ply"]

REASONS_SHOWN = 5
COMPACT_ROWS = 1 << 16


def read_ply(path: AnyPath) -> LoadedSplats:
    """Reads a 3DGS capture from a PLY file (ascii, binary little- or big-endian).

    Properties may have any order and any scalar type; normals and other properties and elements are ignored.
    scale = exp(scale_*), opacity = sigmoid(opacity), rotation = rot_* / |rot_*| (rot_0 is w), SH coefficients raw;
    all float32, so positions given as doubles lose what float32 cannot hold. A splat with a NaN or infinite value
    (before or after activation) or a quaternion of length zero is left out; `warnings` says which properties were bad.

    Peak memory is the cloud plus a few MiB for binary files. Raises StippleError for a file that cannot be opened,
    is not a splat PLY, is damaged, or has no usable splat.
    """
    path = Path(path)
    with open_source(path) as file:
        header = read_header(file, path)
        element, rest_count = splat_element(header, path)
        check_size(header, os.fstat(file.fileno()).st_size, path)
        try:
            splats = _Splats(element.count, rest_count, element.dtype)
            read_rows(file, path, header, element, splats.put)
        except MemoryError as error:
            raise StippleError(
                f"{path}: there is too little memory for {element.count:,} splats; free some."
            ) from error
        except OSError as error:
            raise StippleError(f"{path}: it cannot be read ({error.strerror}); copy it again.") from error
    dropped, reasons = splats.drop_bad()
    if dropped == element.count:
        raise StippleError(f"{path}: all of its {dropped:,} splats are unusable: {reasons}; export it again.")
    warnings = (f"{path}: {dropped:,} of {element.count:,} splats were left out: {reasons}.",) if dropped else ()
    return LoadedSplats(splats.cloud(path.stem), dropped, warnings)


class _Splats:
    """The arrays of a cloud while they are filled, block by block, from up to two threads.

    `arrays` are (N, columns); the columns of each are the properties in `properties`.
    """

    def __init__(self, count: int, rest_count: int, dtype: np.dtype[np.void]) -> None:
        self.properties = properties_of_arrays(rest_count)
        self.runs = _Runs.of(dtype, {name for columns in self.properties.values() for name in columns})
        self.arrays: dict[str, FloatArray] = {
            name: np.empty((count, len(columns)), np.float32) for name, columns in self.properties.items()
        }
        self.indices = {
            name: np.array([self.runs.names.index(column) for column in columns], np.intp)
            for name, columns in self.properties.items()
        }
        self.bad: list[tuple[npt.NDArray[np.intp], Counter[str]]] = []

    def put(self, first: int, rows: Rows) -> None:
        """Converts and activates the rows that become splats `first` and following."""
        with np.errstate(all="ignore"):  # values that overflow are found below; the state belongs to the thread
            raw = self.runs.float_matrix(rows)
            block = {name: array[first : first + len(rows)] for name, array in self.arrays.items()}
            for name, target in block.items():
                if target.shape[1]:
                    np.take(raw, self.indices[name], axis=1, out=target, mode="clip")
            # One sum per array is much cheaper than a test per value; a sum that overflows only costs the full test.
            usable = all(np.isfinite(target.sum()) for name, target in block.items() if name != "rotation")
            if not usable:
                for name in ("scale", "opacity"):  # exp(-inf) would be a finite 0
                    block[name][np.isinf(block[name])] = np.nan
            _activate(block["scale"], block["opacity"])
            norm = _normalise(block["rotation"])
            usable &= bool(np.isfinite(block["scale"].sum()))
            if not (usable and np.min(norm) >= MIN_ROTATION_NORM and np.isfinite(np.max(norm))):
                self._note_bad(first, raw, block, norm)

    def _note_bad(self, first: int, raw: FloatArray, block: dict[str, FloatArray], norm: FloatArray) -> None:
        # Sums again, by row, so that the test of every value is for a few rows only.
        suspect = ~np.isfinite(raw.sum(axis=1)) | ~np.isfinite(block["scale"].sum(axis=1))
        suspect |= ~(norm >= MIN_ROTATION_NORM) | ~np.isfinite(norm)
        rows = np.flatnonzero(suspect)
        few = {name: array[rows] for name, array in block.items()}
        sh = np.concatenate([few["sh_dc"], few["sh_rest"]], axis=1)
        rotation = raw[rows][:, self.indices["rotation"]]
        bad = degenerate_mask(few["position"], few["scale"], rotation, few["opacity"][:, 0], sh)
        if bad.any():
            self.bad.append((first + rows[bad], self._reasons(raw[rows[bad]], few["scale"][bad])))

    def _reasons(self, raw: FloatArray, scale: FloatArray) -> Counter[str]:
        """How many of these bad splats each property spoils."""
        infinite = ~np.isfinite(raw)
        reasons: Counter[str] = Counter()
        for name, columns in self.properties.items():
            for column, index in zip(columns, self.indices[name], strict=True):
                reasons[f"{column} is not finite"] += int(infinite[:, index].sum())
        overflows = ~np.isfinite(scale) & ~infinite[:, self.indices["scale"]]
        for axis, column in enumerate(SCALE):
            reasons[f"{column} is too large"] += int(overflows[:, axis].sum())
        rotation = raw[:, self.indices["rotation"]]
        norm = np.sqrt(np.square(rotation).sum(axis=1))
        zero = ~infinite[:, self.indices["rotation"]].any(axis=1) & ~((norm >= MIN_ROTATION_NORM) & np.isfinite(norm))
        reasons[f"the quaternion {ROTATION[0]} … {ROTATION[-1]} has no direction"] += int(zero.sum())
        return +reasons

    def drop_bad(self) -> tuple[int, str]:
        """Removes the unusable splats, keeping the order of the others; says how many and why."""
        if not self.bad:
            return 0, ""
        keep = np.ones(len(self.arrays["position"]), np.bool_)
        reasons: Counter[str] = Counter()
        for rows, counts in self.bad:
            keep[rows] = False
            reasons += counts
        self.arrays = {name: _compact(array, keep) for name, array in self.arrays.items()}
        shown = [f"{reason} in {count:,}" for reason, count in sorted(reasons.items(), key=lambda item: -item[1])]
        more = len(shown) - REASONS_SHOWN
        text = ", ".join(shown[:REASONS_SHOWN]) + (f" and {more} more" if more > 0 else "")
        return int(len(keep) - keep.sum()), text

    def cloud(self, name: str) -> SplatCloud:
        arrays = dict(self.arrays)
        arrays["opacity"] = arrays["opacity"][:, 0]
        arrays["sh_rest"] = arrays["sh_rest"].reshape(len(arrays["position"]), -1, 3)
        return SplatCloud(**arrays, name=name)


def _activate(scale: FloatArray, opacity: FloatArray) -> None:
    """exp of scales and sigmoid of opacities, in place."""
    np.exp(scale, out=scale)
    np.negative(opacity, out=opacity)
    np.exp(opacity, out=opacity)
    opacity += 1.0
    np.reciprocal(opacity, out=opacity)


def _normalise(rotation: FloatArray) -> FloatArray:
    """Makes quaternions (N, 4) unit quaternions, in place; returns the lengths (N,) they had.

    Column by column: reductions and broadcasts over an axis of four are several times slower in NumPy.
    """
    norm: FloatArray = np.square(rotation[:, 0])
    for axis in range(1, 4):
        norm += np.square(rotation[:, axis])
    np.sqrt(norm, out=norm)
    inverse = np.reciprocal(norm)
    for axis in range(4):
        rotation[:, axis] *= inverse
    return norm


@dataclass(frozen=True)
class _Runs:
    """A row as runs of neighbouring properties of one type: `x y z` and all other float32 ones are one run.

    Runs without a property that is needed are left out; `names` are the properties of the others, in order. `dtype`
    has one opaque field per run, for whole runs are copied fastest; `kinds` are the runs' NumPy types.
    """

    dtype: np.dtype[np.void]
    kinds: tuple[np.dtype[np.generic], ...]
    names: tuple[str, ...]

    @classmethod
    def of(cls, dtype: np.dtype[np.void], needed: set[str]) -> _Runs:
        runs = [(kind, tuple(same)) for kind, same in groupby(dtype.names or (), key=lambda name: dtype[name])]
        runs = [(kind, names) for kind, names in runs if needed.intersection(names)]
        fields: Mapping[str, Any] = dtype.fields or {}
        layout: dict[str, Any] = {
            "names": [names[0] for _, names in runs],
            "formats": [f"V{kind.itemsize * len(names)}" for kind, names in runs],
            "offsets": [fields[names[0]][1] for _, names in runs],
            "itemsize": dtype.itemsize,
        }
        opaque = np.dtype(layout)  # type: ignore[call-overload]
        return cls(opaque, tuple(kind for kind, _ in runs), tuple(name for _, names in runs for name in names))

    def float_matrix(self, rows: Rows) -> FloatArray:
        """The properties `names` of the rows as native float32 (N, names)."""
        matrix = np.empty((len(rows), len(self.names)), np.float32)
        column = 0
        for name, kind in zip(self.dtype.names or (), self.kinds, strict=True):
            values = np.array(rows.view(self.dtype)[name]).view(kind).reshape(len(rows), -1)
            if kind == np.float32 and values.shape == matrix.shape:
                return values
            matrix[:, column : column + values.shape[1]] = values
            column += values.shape[1]
        return matrix


def _compact(array: FloatArray, keep: npt.NDArray[np.bool_]) -> FloatArray:
    """Moves the kept rows to the front, in place: a copy of a large cloud would double the peak memory."""
    end = 0
    for first in range(0, len(array), COMPACT_ROWS):
        rows = array[first : first + COMPACT_ROWS][keep[first : first + COMPACT_ROWS]]
        array[end : end + len(rows)] = rows
        end += len(rows)
    return array[:end]
