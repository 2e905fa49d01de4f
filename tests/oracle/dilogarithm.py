# SPDX-License-Identifier: GPL-3.0-or-later
"""The dilogarithm and its inverse in float64, to about 1e-15 absolute."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from .scene_like import Float64Array

AT_ONE = math.pi**2 / 6.0  # Li2(1)
SERIES_TERMS = 60  # 0.5^60 / 60² is below 1e-21
NEWTON_STEPS = 80


def series(x: Float64Array) -> Float64Array:
    """Σ x^k / k², for |x| <= 1/2."""
    total = np.zeros_like(x)
    for k in range(SERIES_TERMS, 0, -1):
        total = x * (1.0 / k**2 + total)
    return total


def dilogarithm(x: npt.ArrayLike) -> Float64Array:
    """Li2(x) = −∫₀ˣ ln(1 − s)/s ds for −1 <= x <= 1; the shape of x.

    The series where |x| <= 1/2; Euler's reflection Li2(x) + Li2(1 − x) = π²/6 − ln x ln(1 − x) above; Landen's
    Li2(x) = −Li2(x / (x − 1)) − ½ ln²(1 − x) below. Raises ValueError outside the range.
    """
    values = np.asarray(x, dtype=np.float64)
    if not ((values >= -1) & (values <= 1)).all():
        raise ValueError("the dilogarithm is implemented for -1 <= x <= 1")
    result = np.array(series(np.clip(values, -0.5, 0.5)))
    high, low = values > 0.5, values < -0.5
    rest = 1.0 - values[high]
    product = np.where(rest > 0, np.log1p(-rest) * np.log(np.where(rest > 0, rest, 1.0)), 0.0)
    result[high] = AT_ONE - product - series(rest)
    result[low] = -series(values[low] / (values[low] - 1.0)) - 0.5 * np.log1p(-values[low]) ** 2
    return result


def inverse_dilogarithm(y: npt.ArrayLike) -> Float64Array:
    """x in [0, 1] with Li2(x) = y, for 0 <= y <= π²/6; the shape of y.

    Newton's method on Li2' (x) = −ln(1 − x)/x inside a shrinking bracket: the slope has no bound at 1, where plain
    Newton stalls. Raises ValueError outside the range.
    """
    target = np.asarray(y, dtype=np.float64)
    if not ((target >= 0) & (target <= AT_ONE)).all():
        raise ValueError("the inverse dilogarithm is defined for 0 <= y <= pi^2/6")
    low, high = np.zeros_like(target), np.ones_like(target)
    x = np.clip(target / AT_ONE, 0.0, 1.0)
    for _ in range(NEWTON_STEPS):
        error = dilogarithm(x) - target
        low, high = np.where(error <= 0, x, low), np.where(error >= 0, x, high)
        inside = (x > 0) & (x < 1)
        safe = np.where(inside, x, 0.5)
        step = x + error * safe / np.log1p(-safe)  # x − error / slope
        usable = inside & (step >= low) & (step <= high)
        x = np.where(usable, step, 0.5 * (low + high))
    return x
