# SPDX-License-Identifier: GPL-3.0-or-later
"""Does the error of an accumulating renderer fall as one over the samples, without end?

An unbiased renderer with independent samples has a mean squared error of variance / n: slope -1 in log-log. A
systematic error adds a plateau: variance / n + bias². Correlated samples bend the slope.

Both tests take several independent runs and their standard errors from the spread between them, because the points
of one accumulating run are correlated: what the first samples got wrong stays in all later means.

Known power, measured in 100 simulations each and spot-checked in test_convergence.py: eight runs of 4,096 independent
pixel values, samples 1, 2, 4 … 1024, a rate of 1e-3. A plateau at 10 % of the error at 1,024 samples is found with
probability 1.0, at 5 % with 0.7, at 3 % with 0.15. The slope is then known to a standard error of 0.0015, and a
plateau of 10 % bends it by 0.01: the slope alone, held to -1 ± 0.1, would not see it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy import stats

Float64Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Slope:
    """d log MSE / d log samples, and its standard error."""

    value: float
    standard_error: float


@dataclass(frozen=True)
class Plateau:
    """The mean squared error that more samples would not remove.

    `level` and `standard_error` in units of the MSE (may be negative by chance); `p_value` of a level this high if the
    true one is zero, one-sided.
    """

    level: float
    standard_error: float
    p_value: float


def mean_squared_errors(images: npt.ArrayLike, reference: npt.ArrayLike) -> Float64Array:
    """MSE of pictures (…, H, W, C) against one (H, W, C): the leading shape, float64."""
    wanted = np.asarray(reference, dtype=np.float64)
    difference = np.asarray(images, dtype=np.float64) - wanted
    axes = tuple(range(difference.ndim - wanted.ndim, difference.ndim))
    return np.asarray(np.mean(difference**2, axis=axes))


def convergence_slope(samples: npt.ArrayLike, mse: npt.ArrayLike) -> Slope:
    """Least-squares slope of log MSE (R runs, S) over log samples (S,).

    With two runs or more the standard error is the spread of the runs' slopes over √R. With one, (S,) or (1, S), it is
    the regression's own, which is too small for an accumulating run. Raises ValueError for fewer than three sample
    counts or an error of zero (nothing is left to converge).
    """
    x, errors = checked(samples, mse)
    log_x, log_y = np.log(x), np.log(errors)
    centred = log_x - log_x.mean()
    slopes = log_y @ centred / (centred @ centred)
    if len(errors) > 1:
        return Slope(float(np.mean(slopes)), float(np.std(slopes, ddof=1)) / math.sqrt(len(slopes)))
    residual = log_y[0] - log_y[0].mean() - slopes[0] * centred
    return Slope(float(slopes[0]), math.sqrt(float(residual @ residual) / (len(x) - 2) / float(centred @ centred)))


def find_plateau(samples: npt.ArrayLike, mse: npt.ArrayLike) -> Plateau:
    """Test whether the MSE (R runs, S) levels off above zero.

    MSE = variance / n + level makes n · MSE a straight line in n whose slope is the level; n · MSE has about the same
    spread at every n, so plain least squares fits it without weights that depend on the data. One-sided Student's t
    over the runs' levels. It assumes slope -1 before the plateau: test `convergence_slope` too. Raises ValueError
    for fewer than two runs or three sample counts.
    """
    x, errors = checked(samples, mse)
    if len(errors) < 2:
        raise ValueError("a plateau needs at least two independent runs")
    centred = x - x.mean()
    levels = (errors * x) @ centred / (centred @ centred)
    level, error = float(np.mean(levels)), float(np.std(levels, ddof=1)) / math.sqrt(len(levels))
    return Plateau(level, error, float(stats.t.sf(level / error, len(levels) - 1)))


def checked(samples: npt.ArrayLike, mse: npt.ArrayLike) -> tuple[Float64Array, Float64Array]:
    """Sample counts (S,) and errors (R, S) as float64, S >= 3, all positive."""
    x, errors = np.asarray(samples, dtype=np.float64), np.atleast_2d(np.asarray(mse, dtype=np.float64))
    if x.ndim != 1 or len(x) < 3 or errors.ndim != 2 or errors.shape[1] != len(x):
        raise ValueError(f"give samples (S >= 3,) and errors (R, S), not {x.shape} and {errors.shape}")
    if not ((x > 0).all() and (errors > 0).all() and np.isfinite(errors).all()):
        raise ValueError("samples and errors must be positive and finite")
    return x, errors
