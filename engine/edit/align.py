# SPDX-License-Identifier: GPL-3.0-or-later
"""Align one capture with another by pairs of points that an artist picked on both."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ..errors import StippleError
from .affine import Matrix

NEAREST = 1e-9  # [world units] how far apart points are at least
MOST_SCALE = 1e9


def align_points(source: npt.ArrayLike, target: npt.ArrayLike, scale: bool = True) -> Matrix:
    """The map (3, 4), a turn, a move and with `scale` a uniform scale, that brings `source` points nearest to `target`.

    Both (P, 3), P >= 3, in pairs. Least squares in closed form (Umeyama 1991, doi 10.1109/34.88573); it never mirrors.
    Raises StippleError for fewer than three pairs, points in one place or on one line, about which any turn would do,
    and for a scale that no object can have.
    """
    source, target = np.asarray(source, np.float64), np.asarray(target, np.float64)
    if source.shape != target.shape or source.ndim != 2 or source.shape[1:] != (3,) or len(source) < 3:
        raise StippleError("align: pick three or more points on each capture, in pairs.")
    if not (np.isfinite(source).all() and np.isfinite(target).all()):
        raise StippleError("align: a picked point is not finite; pick it again.")
    middles = source.mean(axis=0), target.mean(axis=0)
    from_source, from_target = source - middles[0], target - middles[1]
    for points, middle, which in ((from_source, middles[0], "source"), (from_target, middles[1], "target")):
        spread = np.linalg.svd(points, compute_uv=False)
        if spread[0] < max(NEAREST, 1e-7 * np.abs(middle).max()):  # below that float32 cannot tell places apart
            raise StippleError(f"align: the {which} points are in one place; pick points that are apart.")
        if spread[1] < 1e-6 * spread[0]:
            raise StippleError(f"align: the {which} points lie on one line; pick a point beside it.")
    u, singular, vt = np.linalg.svd(from_target.T @ from_source)
    signs = np.array([1.0, 1.0, np.sign(np.linalg.det(u @ vt))])
    factor = (singular * signs).sum() / (from_source**2).sum() if scale else 1.0
    if not 1 / MOST_SCALE < factor < MOST_SCALE:
        raise StippleError(f"align: the object would be scaled by {factor:.1e}; pick points as far apart on both.")
    linear = factor * (u * signs) @ vt
    return np.column_stack([linear, middles[1] - linear @ middles[0]])
