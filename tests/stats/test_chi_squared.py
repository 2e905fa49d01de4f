# SPDX-License-Identifier: GPL-3.0-or-later
"""The chi-squared test finds wrong Poisson samplers as often as claimed and leaves right ones alone."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import numpy.typing as npt
import pytest

pytest.importorskip("scipy")

from scipy import stats as scipy_stats

from .chi_squared import chi_squared, poisson_chi_squared, poisson_power, pool_bins

Counts = npt.NDArray[np.int64]


def rejected(sampler: Callable[[np.random.Generator], Counts], rate: float, trials: int, level: float) -> float:
    rng = np.random.default_rng(int(1000 * rate))
    return sum(poisson_chi_squared(sampler(rng), rate).p_value < level for _ in range(trials)) / trials


@pytest.mark.parametrize("rate", [0.01, 0.1, 1.0, 10.0, 200.0])
def test_right_samplers_pass_at_the_stated_rate(rate: float) -> None:
    draws, trials = 10_000 if rate < 0.05 else 1000, 400
    fired = rejected(lambda rng: rng.poisson(rate, draws), rate, trials, 0.05)
    assert fired < 0.05 + 4 * math.sqrt(0.05 * 0.95 / trials)


def test_p_values_are_uniform_for_a_right_sampler() -> None:
    rng = np.random.default_rng(11)
    p_values = [poisson_chi_squared(rng.poisson(6.0, 2000), 6.0).p_value for _ in range(500)]
    assert scipy_stats.kstest(p_values, "uniform").pvalue > 1e-3


@pytest.mark.parametrize(("rate", "draws", "claimed"), [(0.1, 100_000, 0.88), (1.0, 20_000, 0.997), (10.0, 2000, 0.97)])
def test_mean_five_percent_off_is_found_as_often_as_claimed(rate: float, draws: int, claimed: float) -> None:
    assert poisson_power(rate, 1.05 * rate, draws) == pytest.approx(claimed, abs=0.005)
    trials = 150
    found = rejected(lambda rng: rng.poisson(1.05 * rate, draws), rate, trials, 1e-3)
    assert found == pytest.approx(claimed, abs=4 * math.sqrt(claimed * (1 - claimed) / trials) + 0.01)


def test_other_powers_of_the_docstring() -> None:
    assert poisson_power(0.01, 0.0105, 1_000_000) == pytest.approx(0.92, abs=0.005)
    assert poisson_power(200.0, 210.0, 500) > 0.999
    assert poisson_power(0.1, 0.2, 2000) > 0.9999
    assert poisson_power(5.0, 5.0, 1000) == pytest.approx(1e-3, rel=1e-6)


@pytest.mark.parametrize(
    ("name", "rate", "sampler"),
    [
        ("one too many", 3.0, lambda rng: rng.poisson(3.0, 5000) + (rng.random(5000) < 0.2)),
        ("tail cut off", 3.0, lambda rng: np.minimum(rng.poisson(3.0, 2000), 6)),
        ("right mean, wrong spread", 3.0, lambda rng: rng.binomial(6, 0.5, 2000)),
        ("rounded to multiples of four", 20.0, lambda rng: rng.poisson(20.0, 2000) // 4 * 4),
        ("normal approximation at a small rate", 0.5, lambda rng: np.maximum(0, np.rint(rng.normal(0.5, 0.71, 5000)))),
        ("twice the mean", 0.1, lambda rng: rng.poisson(0.2, 2000)),
    ],
)
def test_broken_samplers_are_found(name: str, rate: float, sampler: Callable[[np.random.Generator], Counts]) -> None:
    assert rejected(sampler, rate, 5, 1e-3) == 1.0, name


def test_agrees_with_scipy_where_nothing_is_pooled() -> None:
    observed, expected = np.array([12, 18, 30, 40]), np.array([15.0, 20.0, 25.0, 40.0])
    ours, theirs = chi_squared(observed, expected), scipy_stats.chisquare(observed, expected)
    assert (ours.statistic, ours.p_value) == pytest.approx((theirs.statistic, theirs.pvalue), rel=1e-12)
    assert ours.degrees_of_freedom == 3


def test_pooling_depends_on_the_expectation_only() -> None:
    seen, wanted = pool_bins([1, 2, 3, 4, 5, 6], [3.0, 3.0, 9.0, 2.0, 2.5, 1.0])
    np.testing.assert_array_equal(wanted, [6.0, 9.0, 5.5])
    np.testing.assert_array_equal(seen, [3, 3, 15])
    seen, wanted = pool_bins([1, 2, 3], [9.0, 8.0, 1.0])
    np.testing.assert_array_equal(wanted, [9.0, 9.0])
    np.testing.assert_array_equal(seen, [1, 5])


def test_input_that_proves_nothing_is_refused() -> None:
    with pytest.raises(ValueError, match="every outcome"):
        chi_squared([10, 10], [10.0, 20.0])
    with pytest.raises(ValueError, match="more counts"):
        poisson_chi_squared([0, 0, 0, 1], 0.1)
    with pytest.raises(ValueError, match="whole"):
        poisson_chi_squared([1.5, 2.0], 2.0)
