# SPDX-License-Identifier: GPL-3.0-or-later
"""Cut a city's surfaces into patches of equally many splats: one patch, one group of the cloud.

A patch has a grid of fine splats that show detail, three quarters of all, and a coarser one behind it that makes the
surface dense, as training does: what lies behind a wall of a capture is hidden although every splat is soft.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from stipple.engine.errors import StippleError
from stipple.engine.groups import shift_for

from .city_plan import COURTYARD, FIELD, FLAT_ROOF, STREET, TILED_ROOF, TREE, Plan

TREE_SHARE = 0.1  # of all splats, about
SQUARE_METRES_PER_BLOCK = 21_000.0  # of surfaces, measured
SPACING_AT_25M = 0.2  # of fine splats on facades [m]; cities of more splats are larger and finer
COARSER = {FIELD: 7.0, COURTYARD: 1.6, STREET: 1.25, FLAT_ROOF: 1.5, TILED_ROOF: 1.25}  # than on facades


@dataclass(frozen=True)
class Grid:
    """Columns and rows of the fine and the coarse splats of a patch."""

    fine: tuple[int, int]
    coarse: tuple[int, int]

    @classmethod
    def of_shift(cls, shift: int) -> Grid:
        """For 2**shift splats, at least 16."""
        half = 1 << (shift // 2)
        if shift % 2 == 0:
            return cls((half, 3 * half // 4), (half // 2, half // 2))
        return cls((3 * half // 2, half), (half, half // 2))


@dataclass(frozen=True)
class Patches:
    """Per surface the columns and rows of its patches, and the number of its first; one total more in `first`."""

    columns: npt.NDArray[np.int32]
    rows: npt.NDArray[np.int32]
    first: npt.NDArray[np.int32]
    shift: int

    @property
    def count(self) -> int:
        return int(self.first[-1])


def blocks_per_side(splat_count: int) -> int:
    spacing = SPACING_AT_25M * (25e6 / splat_count) ** 0.15
    square_metres = 0.75 * (1 - TREE_SHARE) * splat_count * spacing**2
    return max(2, round(float(np.sqrt(square_metres / SQUARE_METRES_PER_BLOCK))))


def cut_into_patches(plan: Plan, splat_count: int) -> Patches:
    """So many that they hold `splat_count` splats, the last of them not always full.

    Finds the spacing at which the surfaces take their share; trees take what is left. Raises StippleError where there
    are more surfaces than patches.
    """
    shift = shift_for(splat_count)
    wanted = -(-splat_count // (1 << shift))
    is_tree = np.array([surface.kind == TREE for surface in plan.surfaces])
    width, height = (
        np.array([np.linalg.norm(getattr(surface, side)) for surface in plan.surfaces]) for side in ("across", "up")
    )
    coarser = np.array([COARSER.get(surface.kind, 1.0) for surface in plan.surfaces])
    tree_count = int(is_tree.sum())
    if wanted < len(plan.surfaces):
        least = len(plan.surfaces) << shift
        raise StippleError(f"city: {splat_count:,} splats are too few to show it; ask for at least {least:,}.")
    for_trees = max(tree_count, min(round(TREE_SHARE * wanted), wanted - len(plan.surfaces)))
    columns_per_patch, rows_per_patch = Grid.of_shift(shift).fine

    def grids(spacing: float) -> tuple[npt.NDArray[np.int32], npt.NDArray[np.int32]]:
        columns = np.maximum(1, np.round(width / (spacing * coarser * columns_per_patch)))
        rows = np.maximum(1, np.round(height / (spacing * coarser * rows_per_patch)))
        return np.where(is_tree, 1, columns).astype(np.int32), np.where(is_tree, 0, rows).astype(np.int32)

    low, high = 1e-3, 1e3
    for _ in range(60):
        middle = np.sqrt(low * high)
        columns, rows = grids(middle)
        low, high = (low, middle) if (columns.astype(np.int64) * rows).sum() <= wanted - for_trees else (middle, high)
    columns, rows = grids(high)
    left = wanted - int((columns.astype(np.int64) * rows).sum())
    share = np.full(tree_count, left // tree_count)
    share[: left % tree_count] += 1
    rows[is_tree] = share
    first = np.concatenate([[0], np.cumsum(columns.astype(np.int64) * rows)]).astype(np.int32)
    return Patches(columns, rows, first, shift)
