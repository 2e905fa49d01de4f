# SPDX-License-Identifier: GPL-3.0-or-later
"""The convergence tests see plateaus and correlated samples, and accept a renderer that converges."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
import pytest

pytest.importorskip("scipy")

from .convergence import convergence_slope, find_plateau, mean_squared_errors

Float64Array = npt.NDArray[np.float64]
SAMPLES = 2 ** np.arange(11)


def accumulated(rng: np.random.Generator, pixels: int, bias: float = 0.0, runs: int = 8) -> Float64Array:
    """MSE (runs, 11) of accumulating runs of unit variance per sample around a reference that is `bias` away."""
    gaps = np.diff(SAMPLES, prepend=0)
    sums = np.cumsum(rng.normal(size=(runs, len(SAMPLES), pixels)) * np.sqrt(gaps)[:, None], axis=1)
    return np.asarray(np.mean((sums / SAMPLES[:, None] + bias) ** 2, axis=2))


def plateau_of(fraction: float) -> float:
    """Bias whose square is this fraction of the error at the last sample count."""
    return math.sqrt(fraction / SAMPLES[-1])


def test_false_positive_rates() -> None:
    """Neither fires on a renderer that converges; the slope's standard error is true (Student's t, 7 degrees)."""
    rng, trials = np.random.default_rng(1), 600
    level, p_values, slopes = 0.05, [], []
    for _ in range(trials):
        mse = accumulated(rng, 200)
        slope = convergence_slope(SAMPLES, mse)
        slopes.append((slope.value + 1.0) / slope.standard_error)
        p_values.append(find_plateau(SAMPLES, mse).p_value)
    assert np.mean(np.array(p_values) < level) < level + 4 * math.sqrt(level * (1 - level) / trials)
    assert abs(np.mean(slopes)) < 4 * math.sqrt(7 / 5 / trials)
    assert np.std(slopes) == pytest.approx(math.sqrt(7 / 5), rel=0.2)


def test_plateau_of_a_tenth_of_the_last_error_is_found() -> None:
    rng = np.random.default_rng(2)
    for _ in range(10):
        mse = accumulated(rng, 4096, bias=plateau_of(0.1))
        plateau = find_plateau(SAMPLES, mse)
        assert plateau.p_value < 1e-3
        assert plateau.level == pytest.approx(0.1 / 1024, rel=0.4)
        slope = convergence_slope(SAMPLES, mse)
        assert slope.value == pytest.approx(-0.99, abs=0.006)
        assert slope.standard_error == pytest.approx(0.0015, rel=0.8)


def test_small_plateau_is_at_the_edge_of_what_is_claimed() -> None:
    """At 5 % it is found with probability 0.7: neither always nor never in 40 tries."""
    rng = np.random.default_rng(3)
    found = sum(find_plateau(SAMPLES, accumulated(rng, 4096, plateau_of(0.05))).p_value < 1e-3 for _ in range(40))
    assert 40 * 0.7 - 4 * math.sqrt(40 * 0.7 * 0.3) < found < 40


def test_plateau_as_high_as_the_last_error_bends_the_slope() -> None:
    slope = convergence_slope(SAMPLES, accumulated(np.random.default_rng(4), 1024, plateau_of(1.0)))
    assert slope.value > -0.95
    assert (slope.value + 1.0) / slope.standard_error > 5


def test_samples_that_repeat_are_found() -> None:
    """A key that wraps after 64 samples: the mean stops improving."""
    runs = accumulated(np.random.default_rng(5), 1024)
    runs[:, 6:] = runs[:, 6:7]
    assert convergence_slope(SAMPLES, runs).value > -0.9
    assert find_plateau(SAMPLES, runs).p_value < 1e-6


def test_single_run_gives_a_slope_but_no_plateau() -> None:
    mse = accumulated(np.random.default_rng(6), 4096, runs=1)
    slope = convergence_slope(SAMPLES, mse[0])
    assert slope.value == pytest.approx(-1.0, abs=0.02)
    assert 0 < slope.standard_error < 0.02
    with pytest.raises(ValueError, match="two independent runs"):
        find_plateau(SAMPLES, mse)


def test_exact_power_laws() -> None:
    slope = convergence_slope([1, 10, 100], [[1.0, 0.1, 0.01], [3.0, 0.3, 0.03]])
    assert (slope.value, slope.standard_error) == pytest.approx((-1.0, 0.0), abs=1e-12)
    plateau = find_plateau([1, 2, 4], [[1.5, 1.0, 0.75], [2.6, 1.6, 1.1]])  # 1/n + 0.5 and 2/n + 0.6
    assert plateau.level == pytest.approx(0.55)
    assert plateau.standard_error == pytest.approx(0.05)


def test_mean_squared_errors() -> None:
    images = np.zeros((2, 3, 4, 4, 1))
    images[1] += 0.5
    np.testing.assert_allclose(mean_squared_errors(images, np.zeros((4, 4, 1))), [[0.0] * 3, [0.25] * 3])


def test_input_that_does_not_fit_is_refused() -> None:
    with pytest.raises(ValueError, match="S >= 3"):
        convergence_slope([1, 2], [1.0, 0.5])
    with pytest.raises(ValueError, match="positive"):
        convergence_slope([1, 2, 4], [1.0, 0.5, 0.0])
