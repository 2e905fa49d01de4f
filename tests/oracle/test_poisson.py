# SPDX-License-Identifier: GPL-3.0-or-later
"""The Poisson distribution against exact fractions and SciPy."""

from __future__ import annotations

import math
from decimal import Decimal, localcontext

import numpy as np
import pytest

from .poisson import poisson_cdf, poisson_pmf

scipy_stats = pytest.importorskip("scipy.stats")
RATES = (0.01, 0.5, 1.0, 9.99, 10.0, 57.3, 200.0, 900.0)


def decimal_pmf(count: int, rate: float) -> float:
    with localcontext() as context:
        context.prec = 60
        return float(Decimal(rate) ** count * (-Decimal(rate)).exp() / Decimal(math.factorial(count)))


@pytest.mark.parametrize("rate", RATES)
def test_mass_is_exact_in_sixty_digit_arithmetic(rate: float) -> None:
    counts = sorted({0, 1, 5, int(rate), int(rate + 6 * math.sqrt(rate)), max(0, int(rate - 6 * math.sqrt(rate)))})
    expected = [decimal_pmf(count, rate) for count in counts]
    np.testing.assert_allclose(poisson_pmf(counts, rate), expected, rtol=2e-12)


@pytest.mark.parametrize("rate", RATES)
def test_distribution_agrees_with_scipy_and_sums_to_one(rate: float) -> None:
    counts = np.arange(-1, int(rate + 12 * math.sqrt(rate)) + 20)
    np.testing.assert_allclose(
        poisson_cdf(counts, rate), scipy_stats.poisson.cdf(counts, rate), rtol=1e-11, atol=1e-300
    )
    mass = poisson_pmf(counts, rate)
    assert mass.sum() == pytest.approx(1.0, abs=1e-12)
    assert (mass * counts).sum() == pytest.approx(rate, rel=1e-12)


def test_edges() -> None:
    np.testing.assert_array_equal(poisson_pmf([-1, 0, 1], 0.0), [0.0, 1.0, 0.0])
    np.testing.assert_array_equal(poisson_cdf([-1, 0, 7], 0.0), [0.0, 1.0, 1.0])
    with pytest.raises(ValueError, match="not negative"):
        poisson_pmf(1, -1.0)
