# SPDX-License-Identifier: GPL-3.0-or-later
"""From rows of a PLY file to splats: properties picked, activated, and what cannot be rendered found."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import groupby
from typing import Any

import numpy as np
import numpy.typing as npt

from ..splats import MIN_ROTATION_NORM, FloatArray, degenerate_mask
from .ply_layout import ROTATION, SCALE, properties_of_arrays
from .ply_rows import Rows

CERTAINLY_FINITE_LOG = 88.7  # exp(88.72) is the largest float32

BadRows = tuple[npt.NDArray[np.intp], Counter[str]]
"""Indices of rows that cannot be rendered, and how many of them each reason spoils."""


class RowConverter:
    """Knows where in a row the columns of each of a cloud's arrays are; has no state, so threads may share it."""

    def __init__(self, rest_count: int, dtype: np.dtype[np.void]) -> None:
        self.properties = properties_of_arrays(rest_count)
        self._runs = _Runs.of(dtype, {name for columns in self.properties.values() for name in columns})
        self._indices = {
            name: np.array([self._runs.names.index(column) for column in columns], np.intp)
            for name, columns in self.properties.items()
        }

    def convert(self, rows: Rows, targets: Mapping[str, FloatArray]) -> BadRows | None:
        """Fills `targets`, (rows, columns) each, with activated values; None where every row can be rendered.

        What is found does not depend on which arrays there are targets for.
        """
        with np.errstate(all="ignore"):  # values that overflow are found below; the state belongs to the thread
            raw = self._runs.float_matrix(rows)
            for name, target in targets.items():
                if target.shape[1]:
                    np.take(raw, self._indices[name], axis=1, out=target, mode="clip")
            if "scale" in targets:
                np.exp(targets["scale"], out=targets["scale"])
            if "opacity" in targets:
                _sigmoid(targets["opacity"])
            norm = _lengths(raw, self._indices["rotation"])
            if "rotation" in targets:
                inverse = np.reciprocal(norm)
                for axis in range(4):  # by column: NumPy is several times slower along an axis of four
                    targets["rotation"][:, axis] *= inverse
            return None if self._are_surely_usable(raw, norm) else self._find_bad(raw)

    def _are_surely_usable(self, raw: FloatArray, norm: FloatArray) -> bool:
        # One sum is much cheaper than a test per value; a sum that overflows only costs the full test.
        if not (np.isfinite(raw.sum()) and np.min(norm) >= MIN_ROTATION_NORM and np.isfinite(np.max(norm))):
            return False
        return all(raw[:, index].max() < CERTAINLY_FINITE_LOG for index in self._indices["scale"])

    def _find_bad(self, raw: FloatArray) -> BadRows | None:
        # Sums again, by row, so that the test of every value is for a few rows only.
        norm = _lengths(raw, self._indices["rotation"])
        suspect = ~np.isfinite(raw.sum(axis=1)) | ~(norm >= MIN_ROTATION_NORM) | ~np.isfinite(norm)
        suspect |= ~(raw[:, self._indices["scale"]] < CERTAINLY_FINITE_LOG).all(axis=1)
        rows = np.flatnonzero(suspect)
        few = {name: raw[rows][:, indices] for name, indices in self._indices.items()}
        for name in ("scale", "opacity"):  # exp(-inf) would be a finite 0
            few[name][np.isinf(few[name])] = np.nan
        few["scale"] = np.exp(few["scale"])
        sh = np.concatenate([few["sh_dc"], few["sh_rest"]], axis=1)
        bad = degenerate_mask(few["position"], few["scale"], few["rotation"], few["opacity"][:, 0], sh)
        if not bad.any():
            return None
        return rows[bad], self._reasons(raw[rows[bad]], few["scale"][bad])

    def _reasons(self, raw: FloatArray, scale: FloatArray) -> Counter[str]:
        """How many of these bad splats each property spoils."""
        infinite = ~np.isfinite(raw)
        reasons: Counter[str] = Counter()
        for name, columns in self.properties.items():
            for column, index in zip(columns, self._indices[name], strict=True):
                reasons[f"{column} is not finite"] += int(infinite[:, index].sum())
        overflows = ~np.isfinite(scale) & ~infinite[:, self._indices["scale"]]
        for axis, column in enumerate(SCALE):
            reasons[f"{column} is too large"] += int(overflows[:, axis].sum())
        rotation = raw[:, self._indices["rotation"]]
        norm = np.sqrt(np.square(rotation).sum(axis=1))
        zero = ~infinite[:, self._indices["rotation"]].any(axis=1) & ~((norm >= MIN_ROTATION_NORM) & np.isfinite(norm))
        reasons[f"the quaternion {ROTATION[0]} … {ROTATION[-1]} has no direction"] += int(zero.sum())
        return +reasons


def _sigmoid(logit: FloatArray) -> None:
    """In place."""
    np.negative(logit, out=logit)
    np.exp(logit, out=logit)
    logit += 1.0
    np.reciprocal(logit, out=logit)


def _lengths(raw: FloatArray, columns: npt.NDArray[np.intp]) -> FloatArray:
    """Of the vectors (N,) whose components are in these columns."""
    norm: FloatArray = np.square(raw[:, columns[0]])
    for column in columns[1:]:
        norm += np.square(raw[:, column])
    return np.sqrt(norm, out=norm)


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
        """The properties `names` of the rows as native float32 (N, names), not to be written to."""
        matrix = np.empty((len(rows), len(self.names)), np.float32)
        column = 0
        for name, kind in zip(self.dtype.names or (), self.kinds, strict=True):
            values = np.ascontiguousarray(rows.view(self.dtype)[name]).view(kind).reshape(len(rows), -1)
            if kind == np.float32 and values.shape == matrix.shape:
                return values
            matrix[:, column : column + values.shape[1]] = values
            column += values.shape[1]
        return matrix
