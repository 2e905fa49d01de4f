# SPDX-License-Identifier: GPL-3.0-or-later
"""Pearson's chi-squared test of counts against a distribution, with sparse bins pooled.

Known power, from `poisson_power` and checked in test_chi_squared.py, at a false-positive rate of 1e-3 for a Poisson
sampler whose mean is 5 % too high: rate 0.01, 1,000,000 draws: 0.92; rate 0.1, 100,000 draws: 0.88; rate 1,
20,000 draws: 0.997; rate 10, 2,000 draws: 0.97; rate 200, 500 draws: above 0.999. A mean twice too high at rate 0.1 is
found in 2,000 draws with probability above 0.9999.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy import stats

from ..oracle.poisson import poisson_cdf, poisson_pmf

Float64Array = npt.NDArray[np.float64]
MIN_EXPECTED = 5.0


@dataclass(frozen=True)
class ChiSquared:
    """Statistic, degrees of freedom (pooled bins - 1) and p value."""

    statistic: float
    degrees_of_freedom: int
    p_value: float


def pool_bins(
    observed: npt.ArrayLike, expected: npt.ArrayLike, min_expected: float = MIN_EXPECTED
) -> tuple[Float64Array, Float64Array]:
    """Join neighbouring bins from the left until each expects `min_expected`; a poor last one joins the one before.

    Which bins are joined depends on the expectation alone, so that it cannot favour an outcome.
    """
    seen, wanted = np.asarray(observed, dtype=np.float64), np.asarray(expected, dtype=np.float64)
    starts, filled = [0], 0.0
    for index, value in enumerate(wanted):
        if filled >= min_expected:
            starts.append(index)
            filled = 0.0
        filled += float(value)
    if filled < min_expected and len(starts) > 1:
        starts.pop()
    return np.add.reduceat(seen, starts), np.add.reduceat(wanted, starts)


def chi_squared(observed: npt.ArrayLike, expected: npt.ArrayLike, min_expected: float = MIN_EXPECTED) -> ChiSquared:
    """Test observed counts (B,) against expected counts (B,) of the same total, no parameter fitted.

    Bins that expect less than `min_expected` are pooled with their neighbours. Raises ValueError when the totals differ
    (a bin is missing: add the tail), or when fewer than two bins remain (nothing could be found).
    """
    seen, wanted = pool_bins(observed, expected, min_expected)
    if not math.isclose(float(seen.sum()), float(wanted.sum()), rel_tol=1e-9):
        raise ValueError(f"{seen.sum()} observed but {wanted.sum()} expected: the bins must cover every outcome")
    if len(seen) < 2:
        raise ValueError("one bin remains after pooling: give more counts")
    statistic = float(((seen - wanted) ** 2 / wanted).sum())
    return ChiSquared(statistic, len(seen) - 1, float(stats.chi2.sf(statistic, len(seen) - 1)))


def poisson_expected(rate: float, draws: int) -> Float64Array:
    """Expected counts of 0, 1, …, last and of everything above `last`, where next to nothing is."""
    last = math.ceil(rate + 10.0 * math.sqrt(rate) + 10.0)
    mass = poisson_pmf(np.arange(last + 1), rate)
    return draws * np.append(mass, 1.0 - float(poisson_cdf(last, rate)))


def poisson_chi_squared(counts: npt.ArrayLike, rate: float) -> ChiSquared:
    """Test sampled counts (N,) of whole numbers against the Poisson distribution of `rate`.

    Raises ValueError for a negative count or one that is not whole.
    """
    values = np.asarray(counts).ravel()
    if (values < 0).any() or (values != np.floor(values)).any():
        raise ValueError("Poisson counts are whole and not negative")
    expected = poisson_expected(rate, len(values))
    top = len(expected) - 1
    observed = np.bincount(np.minimum(values, top).astype(np.int64), minlength=top + 1)
    return chi_squared(observed, expected)


def poisson_power(rate: float, sampled_rate: float, draws: int, false_positive_rate: float = 1e-3) -> float:
    """Probability that `poisson_chi_squared` rejects `rate` when the sampler's rate is `sampled_rate`.

    From the noncentral chi-squared distribution, exact in the limit of many draws.
    """
    expected = poisson_expected(rate, draws)
    mass = poisson_pmf(np.arange(len(expected) - 1), sampled_rate)
    shifted = draws * np.append(mass, 1.0 - float(mass.sum()))
    means, wanted = pool_bins(shifted, expected)
    noncentrality = float(((means - wanted) ** 2 / wanted).sum())
    limit = float(stats.chi2.isf(false_positive_rate, len(wanted) - 1))
    return float(stats.ncx2.sf(limit, len(wanted) - 1, noncentrality))
