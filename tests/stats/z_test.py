# SPDX-License-Identifier: GPL-3.0-or-later
"""Is the mean of R independently seeded pictures the reference? Over the whole picture, and tile by tile.

The standard error comes from the spread between seeds and from nothing else, so it needs no model of the renderer's
noise and counts any correlation between pixels. With R seeds the studentised difference follows Student's t with
R - 1 degrees of freedom, not a normal distribution; p values are those of t. Many tiles are held to one overall
false-positive rate by Šidák's correction.

A group of pixels that every seed gave the same value (spread within `FLOAT_TOLERANCE`) has no noise to hide behind: its
mean must equal the reference within `FLOAT_TOLERANCE`, else p = 0 and z = ±inf. There is no floor under any other
spread.

Known power, from `power` and checked in test_z_test.py, for 32 seeds at an overall false-positive rate of 1e-3. The
unit is the standard deviation of a tile's mean from seed to seed. Among 1,200 tests (300 tiles, 4 channels) a bias of
1 unit in one tile is found with probability 0.37, of 1.25 with 0.78, of 1.5 with 0.97. The pooled test finds 0.5
units of the whole picture's mean with 0.24 and 1 with 0.97. 64 seeds find 1 unit in one tile with 0.99.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy import stats

Float64Array = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

FLOAT_TOLERANCE = 2e-6  # of values near 1: a few float32 roundings
POWER_NODES = 400


@dataclass(frozen=True, eq=False)
class ZTest:
    """Outcome for G groups of pixels and C channels.

    - `z` (G, C): (mean over seeds - reference) / standard error; ±inf for a wrong group without spread.
    - `p` (G, C): probability of a |z| at least this large if the mean is the reference.
    - `bias` (G, C): mean over seeds - reference, in the pictures' units.
    """

    z: Float64Array
    p: Float64Array
    bias: Float64Array

    def passes(self, false_positive_rate: float = 1e-3) -> bool:
        """Whether no group and channel deviates, at this probability of a false alarm over all of them together."""
        return bool((self.p >= sidak_level(false_positive_rate, self.p.size)).all())

    def worst(self) -> str:
        """The most significant deviation, in words, for an assertion's message."""
        group, channel = np.unravel_index(np.argmin(self.p), self.p.shape)
        z, p, bias = (float(values[group, channel]) for values in (self.z, self.p, self.bias))
        return f"group {group}, channel {channel}: bias {bias:.3g}, z {z:.2f}, p {p:.3g} of {self.p.size} tests"


def sidak_level(false_positive_rate: float, test_count: int) -> float:
    """Level of each of `test_count` tests that together fire at `false_positive_rate` (Šidák, 1967).

    Exact for independent tests, never too lax for positively dependent ones, such as the channels of one picture.
    """
    return -math.expm1(math.log1p(-false_positive_rate) / test_count)


def power(
    bias_in_deviations: float, seed_count: int, *, false_positive_rate: float = 1e-3, test_count: int = 1
) -> float:
    """Probability that a group is found whose mean is off by that many seed-to-seed standard deviations.

    The noncentral t distribution, integrated over the standard error that the seeds happen to show (SciPy's own
    returns NaN for some of these arguments): holds for group means that are close to normally distributed.
    """
    dof = seed_count - 1
    limit = float(stats.t.isf(sidak_level(false_positive_rate, test_count) / 2, dof))
    shift = bias_in_deviations * math.sqrt(seed_count)
    nodes, weights = np.polynomial.legendre.leggauss(POWER_NODES)
    top = float(stats.chi2.isf(1e-15, dof))
    variance = 0.5 * top * (nodes + 1.0)  # times dof over the true variance: chi-squared
    threshold = limit * np.sqrt(variance / dof)
    found = stats.norm.sf(threshold - shift) + stats.norm.cdf(-threshold - shift)
    return float(0.5 * top * np.sum(weights * stats.chi2.pdf(variance, dof) * found))


def z_test(images: npt.ArrayLike, reference: npt.ArrayLike, groups: IntArray | None = None) -> ZTest:
    """Compare the mean of `images` (R, H, W, C) with `reference` (H, W, C), group by group.

    `groups` (H, W) numbers the pixels' groups from 0, as `tile_groups` makes them; None puts all into one, the pooled
    test: the most powerful against a bias of one sign, blind to biases that cancel. The grouping must not depend on
    `images`.

    Assumes that seeds are independent and that a group's mean is near enough to normal over seeds. That fails for
    rare events. Measured with Poisson counts, 32 seeds and a level of 1e-4: a group that sees 10 points per seed fires
    1.6 times as often as stated, 3 points 2.4 times, 1 point 7.5 times; with 0.1 points 4 % are constant by chance
    and are called wrong. Let `tile_groups` pool what sees fewer than about 30.

    Raises ValueError for shapes that do not fit, fewer than two seeds, or values that are not finite.
    """
    pictures, wanted = np.asarray(images), np.asarray(reference)
    if pictures.ndim != 4 or pictures.shape[1:] != wanted.shape or len(pictures) < 2:
        raise ValueError(
            f"give images (R >= 2, H, W, C) and a reference (H, W, C), not {pictures.shape}, {wanted.shape}"
        )
    if not (np.isfinite(pictures).all() and np.isfinite(wanted).all()):
        raise ValueError("images and reference must be finite")
    labels = np.zeros(wanted.shape[:2], dtype=np.int64) if groups is None else groups
    means = np.stack([group_means(picture, labels) for picture in pictures])
    bias = means.mean(axis=0) - group_means(wanted, labels)
    constant = np.ptp(means, axis=0) <= FLOAT_TOLERANCE
    error = np.where(constant, 1.0, means.std(axis=0, ddof=1) / math.sqrt(len(means)))
    verdict = np.where(np.abs(bias) <= FLOAT_TOLERANCE, 0.0, np.copysign(np.inf, bias))
    z = np.where(constant, verdict, bias / error)
    return ZTest(z, 2.0 * stats.t.sf(np.abs(z), len(means) - 1), bias)


def group_means(picture: npt.NDArray[np.floating], groups: IntArray) -> Float64Array:
    """Mean of each group: (H, W, C) to (G, C) float64."""
    labels = groups.ravel()
    sizes = np.bincount(labels)
    flat = picture.reshape(len(labels), -1)
    return np.stack([np.bincount(labels, weights=channel) / sizes for channel in flat.T], axis=1)


def tile_groups(
    height: int, width: int, tile_px: int, expected_events: npt.ArrayLike | None = None, min_events: float = 0.0
) -> IntArray:
    """Group numbers (height, width) of square tiles, row by row; tiles at the right and bottom edge may be smaller.

    With `expected_events` (height, width), the events a pixel expects per seed (points that land there: for the points
    method at most samples times opacity), tiles that expect fewer than `min_events` but more than none are pooled
    into one group of their own, as the bins of a chi-squared test are. A tile that expects none stays a tile: it has
    to be constant. Groups are numbered without gaps; which tile got which number is then no longer its place.
    """
    rows, columns = np.arange(height) // tile_px, np.arange(width) // tile_px
    labels = rows[:, None] * (columns[-1] + 1) + columns
    if expected_events is not None:
        events = np.bincount(labels.ravel(), weights=np.asarray(expected_events, dtype=np.float64).ravel())
        sparse = (events > 0) & (events < min_events)
        labels = np.where(sparse[labels], labels.max() + 1, labels)
    return np.unique(labels, return_inverse=True)[1].reshape(height, width).astype(np.int64)
