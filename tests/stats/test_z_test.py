# SPDX-License-Identifier: GPL-3.0-or-later
"""The z-test fires on planted biases as often as it claims, and on correct pictures no more often than it claims."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
import pytest

pytest.importorskip("scipy")

from scipy import stats

from .z_test import FLOAT_TOLERANCE, power, sidak_level, tile_groups, z_test

TILE_PX = 6
SIZE = (24, 24, 3)


def binomial_bounds(probability: float, trials: int) -> tuple[float, float]:
    """A fraction of successes leaves these bounds once in 16,000 times (4 standard deviations)."""
    margin = 4.0 * math.sqrt(probability * (1 - probability) / trials)
    return probability - margin, probability + margin


def noise(rng: np.random.Generator, seed_count: int) -> npt.NDArray[np.float32]:
    """Pictures of normal noise around 0.5 whose strength varies over the picture."""
    strength = np.linspace(0.01, 0.3, SIZE[0])[:, None, None]
    return (0.5 + rng.normal(size=(seed_count, *SIZE)) * strength).astype(np.float32)


def coverage(rng: np.random.Generator, seed_count: int, opacity: npt.NDArray[np.float64], samples: int) -> npt.NDArray:
    """What the points method sees: the fraction of samples in which a point covered the pixel."""
    return (rng.binomial(samples, opacity, size=(seed_count, *opacity.shape)) / samples)[..., None]


def test_p_values_are_those_of_students_t_test() -> None:
    images, groups = noise(np.random.default_rng(12), 6), tile_groups(24, 24, 12)
    result = z_test(images, np.full(SIZE, 0.49), groups)
    tile_means = images[:, 12:, :12, 2].astype(np.float64).mean(axis=(1, 2))
    expected = stats.ttest_1samp(tile_means, 0.49)
    assert result.z[2, 2] == pytest.approx(expected.statistic, rel=1e-9)
    assert result.p[2, 2] == pytest.approx(expected.pvalue, rel=1e-9)
    assert result.bias[2, 2] == pytest.approx(tile_means.mean() - 0.49, rel=1e-9)


def test_false_positive_rate_of_the_pooled_test() -> None:
    rng, trials = np.random.default_rng(1), 1000
    fired = sum(not z_test(rng.normal(size=(5, 2, 2, 1)), np.zeros((2, 2, 1))).passes(0.05) for _ in range(trials))
    low, high = binomial_bounds(0.05, trials)
    assert low < fired / trials < high


def test_false_positive_rate_over_all_tiles_together() -> None:
    rng, trials, groups = np.random.default_rng(2), 400, tile_groups(24, 24, TILE_PX)
    reference = np.full(SIZE, 0.5)
    fired = sum(not z_test(noise(rng, 10), reference, groups).passes(0.05) for _ in range(trials))
    low, high = binomial_bounds(0.05, trials)
    assert low < fired / trials < high


def test_noise_shared_by_all_pixels_of_a_seed_does_not_fire_it() -> None:
    """An error from pixels instead of seeds would be six times too small here and fire most of the time."""
    rng, trials = np.random.default_rng(3), 300
    fired = 0
    for _ in range(trials):
        images = noise(rng, 10) + rng.normal(scale=0.1, size=(10, 1, 1, 1))
        fired += not z_test(images[..., :1], np.full((24, 24, 1), 0.5)).passes(0.05)
    low, high = binomial_bounds(0.05, trials)
    assert low < fired / trials < high


@pytest.mark.parametrize("deviations", [1.0, 1.5])
def test_bias_in_one_tile_is_found_as_often_as_claimed(deviations: float) -> None:
    rng, trials, seeds, groups = np.random.default_rng(4), 200, 16, tile_groups(24, 24, TILE_PX)
    strength = np.linspace(0.01, 0.3, SIZE[0])[12:18]
    tile_deviation = math.sqrt(TILE_PX * float((strength**2).sum())) / TILE_PX**2
    reference, found = np.full(SIZE, 0.5), 0
    for _ in range(trials):
        images = noise(rng, seeds)
        images[:, 12:18, 6:12, 1] += deviations * tile_deviation
        found += not z_test(images, reference, groups).passes(0.01)
    expected = power(deviations, seeds, false_positive_rate=0.01, test_count=48)
    low, high = binomial_bounds(expected, trials)
    assert low < found / trials < high + 0.01  # a false alarm elsewhere counts as found


def test_power_claimed_in_the_docstring() -> None:
    claims = {1.0: 0.37, 1.25: 0.78, 1.5: 0.97}
    for deviations, claimed in claims.items():
        assert power(deviations, 32, test_count=1200) == pytest.approx(claimed, abs=0.006)
    assert power(0.5, 32) == pytest.approx(0.24, abs=0.005)
    assert power(1.0, 32) == pytest.approx(0.97, abs=0.005)
    assert power(1.0, 64, test_count=1200) == pytest.approx(0.99, abs=0.005)
    assert power(0.0, 32, test_count=1200) == pytest.approx(sidak_level(1e-3, 1200), rel=1e-3)


def test_five_percent_too_few_points_in_one_tile_are_found() -> None:
    rng, opacity = np.random.default_rng(5), np.full((48, 48), 0.4)
    groups = tile_groups(48, 48, 8)
    planted = opacity.copy()
    planted[16:24, 32:40] *= 0.95
    right = z_test(coverage(rng, 32, opacity, 16), opacity[..., None], groups)
    wrong = z_test(coverage(rng, 32, planted, 16), opacity[..., None], groups)
    assert right.passes()
    assert not wrong.passes()
    assert np.argmin(wrong.p) == 2 * 6 + 4
    assert wrong.bias[16, 0] == pytest.approx(-0.02, abs=0.006)
    assert "group 16, channel 0" in wrong.worst()


def test_opacity_of_63_percent_instead_of_100_is_found_by_the_pooled_test() -> None:
    rng, opacity = np.random.default_rng(6), np.full((8, 8), 1.0)
    assert z_test(coverage(rng, 8, opacity, 4), opacity[..., None]).passes()
    assert not z_test(coverage(rng, 8, opacity * (1 - math.exp(-1)), 4), opacity[..., None]).passes()


def test_biases_that_cancel_escape_the_pooled_test_only() -> None:
    images, reference = noise(np.random.default_rng(7), 32), np.full(SIZE, 0.5)
    images[:, :12] += 0.05
    images[:, 12:] -= 0.05
    assert z_test(images, reference).passes()
    assert not z_test(images, reference, tile_groups(24, 24, TILE_PX)).passes()


def test_rare_events_are_calibrated_once_sparse_tiles_are_pooled() -> None:
    """A soft edge down to an opacity of 1/255: alone, its outermost tiles would fire far too often."""
    rng, trials, samples = np.random.default_rng(8), 200, 4
    opacity = np.where(np.arange(48) < 36, 0.9 * 0.86 ** np.arange(48), 0.0)[None, :] * np.ones((8, 1))
    opacity[opacity < 1 / 255] = 0.0
    pooled = tile_groups(8, 48, 4, expected_events=samples * opacity, min_events=30)
    alone = tile_groups(8, 48, 4)
    fired = {"pooled": 0, "alone": 0}
    for _ in range(trials):
        images = coverage(rng, 16, opacity, samples)
        fired["pooled"] += not z_test(images, opacity[..., None], pooled).passes(0.05)
        fired["alone"] += not z_test(images, opacity[..., None], alone).passes(0.05)
    assert fired["pooled"] / trials < binomial_bounds(0.05, trials)[1]
    assert fired["alone"] > fired["pooled"]


def test_constant_groups_must_equal_the_reference() -> None:
    images = np.full((4, 2, 4, 1), 0.7, dtype=np.float32)
    reference = np.full((2, 4, 1), 0.7)
    groups = tile_groups(2, 4, 2)
    assert z_test(images, reference, groups).passes()
    assert z_test(images, reference + 0.5 * FLOAT_TOLERANCE, groups).passes()
    reference[:, 2:] += 1e-4
    result = z_test(images, reference, groups)
    np.testing.assert_array_equal(result.z[:, 0], [0.0, -np.inf])
    np.testing.assert_array_equal(result.p[:, 0], [1.0, 0.0])
    assert not result.passes()


def test_there_is_no_variance_floor() -> None:
    """A bias of 2e-5 is found where the noise is small enough to show it."""
    images = 0.5 + np.random.default_rng(9).normal(scale=1e-5, size=(32, 2, 2, 1))
    assert z_test(images, np.full((2, 2, 1), 0.5)).passes()
    assert not z_test(images + 2e-5, np.full((2, 2, 1), 0.5)).passes()


def test_tile_groups() -> None:
    np.testing.assert_array_equal(tile_groups(3, 5, 2), [[0, 0, 1, 1, 2], [0, 0, 1, 1, 2], [3, 3, 4, 4, 5]])
    events = np.array([[9, 9, 1, 0, 0, 0], [9, 9, 0, 2, 0, 0]])
    np.testing.assert_array_equal(tile_groups(2, 6, 2, events, min_events=5), [[0, 0, 2, 2, 1, 1]] * 2)


def test_sidak_level() -> None:
    assert 1 - (1 - sidak_level(0.05, 300)) ** 300 == pytest.approx(0.05)
    assert sidak_level(1e-3, 1) == pytest.approx(1e-3)


def test_input_that_does_not_fit_is_refused() -> None:
    with pytest.raises(ValueError, match="R >= 2"):
        z_test(np.zeros((1, 2, 2, 1)), np.zeros((2, 2, 1)))
    with pytest.raises(ValueError, match="R >= 2"):
        z_test(np.zeros((3, 2, 2, 4)), np.zeros((2, 2, 3)))
    with pytest.raises(ValueError, match="finite"):
        z_test(np.full((3, 2, 2, 1), np.nan), np.zeros((2, 2, 1)))
