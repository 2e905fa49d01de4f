# SPDX-License-Identifier: GPL-3.0-or-later
"""Dilogarithm, Poisson counts and random numbers, against float64 references and by their distributions."""

from __future__ import annotations

import numpy as np
import pytest
import warp as wp

from stipple.engine.device import choose_device, launch
from stipple.engine.maths.dilogarithm import li2, li2_inverse
from stipple.engine.maths.poisson import poisson
from stipple.engine.maths.random import pcg3d, stream_key, uniform_open
from tests.oracle.dilogarithm import dilogarithm
from tests.stats.chi_squared import chi_squared, poisson_chi_squared

PAPER_LI2_ERROR = 7.27e-5
PAPER_INVERSE_ERROR = 7.07e-5


@wp.kernel
def li2_kernel(first: wp.int32, x: wp.array(dtype=wp.float32), y: wp.array(dtype=wp.float32)) -> None:
    i = first + wp.tid()
    y[i] = li2(x[i])


@wp.kernel
def li2_inverse_kernel(first: wp.int32, x: wp.array(dtype=wp.float32), y: wp.array(dtype=wp.float32)) -> None:
    i = first + wp.tid()
    y[i] = li2_inverse(x[i])


@wp.kernel
def poisson_kernel(first: wp.int32, rate: wp.float32, stream: wp.uint32, counts: wp.array(dtype=wp.int32)) -> None:
    i = first + wp.tid()
    bits = pcg3d(wp.vec3ui(wp.uint32(i), stream, wp.uint32(7)))
    counts[i] = poisson(rate, wp.vec3(uniform_open(bits[0]), uniform_open(bits[1]), uniform_open(bits[2])))


@wp.kernel
def pcg3d_kernel(first: wp.int32, keys: wp.array(dtype=wp.vec3ui), bits: wp.array(dtype=wp.vec3ui)) -> None:
    i = first + wp.tid()
    bits[i] = pcg3d(keys[i])


def mapped(kernel: wp.Kernel, x: np.ndarray, device: str) -> np.ndarray:
    source = wp.array(x.astype(np.float32), dtype=wp.float32, device=device)
    result = wp.empty_like(source)
    launch(kernel, len(x), [source, result], choose_device(device))
    return result.numpy().astype(np.float64)


def test_li2_over_the_whole_range(device: str) -> None:
    ends = np.concatenate([np.geomspace(1e-9, 0.1, 4000), 1 - np.geomspace(1e-7, 0.1, 4000), [1.0, 0.5]])
    x = np.concatenate([np.linspace(0, 1, 20001), ends]).astype(np.float32)
    error = np.abs(mapped(li2_kernel, x, device) - dilogarithm(x.astype(np.float64)))
    assert error.max() < 1e-6 < PAPER_LI2_ERROR


def test_li2_inverse_over_the_whole_range(device: str) -> None:
    x = np.concatenate([np.linspace(1e-6, 1, 20001), np.geomspace(1e-9, 0.1, 4000), 1 - np.geomspace(1e-7, 0.1, 4000)])
    found = mapped(li2_inverse_kernel, dilogarithm(x), device)
    assert np.abs(found - x).max() < 3e-5 < PAPER_INVERSE_ERROR
    # Where opacities are not clamped, and relatively, so that faint splats keep theirs.
    assert np.abs(found / x - 1)[x < 0.99].max() < 5e-6


@pytest.mark.parametrize("rate", [0.01, 0.02, 0.1, 0.5, 1.0, 3.0, 9.99, 10.01, 15.0, 30.0, 80.0, 200.0])
def test_poisson_counts_have_the_poisson_distribution(device: str, rate: float) -> None:
    """200,000 counts find a mean that is 1 % off at λ = 1 and 0.2 % off at λ = 100 (tests/stats/chi_squared.py)."""
    counts = wp.empty(200_000, dtype=wp.int32, device=device)
    key = wp.uint32(stream_key(1, 2, int(100 * rate)))
    launch(poisson_kernel, counts.size, [rate, key, counts], choose_device(device))
    assert poisson_chi_squared(counts.numpy(), rate).p_value > 1e-4


@pytest.mark.parametrize("rate", [1e-6, 1e-5])
def test_tiny_rates_are_exact(device: str, rate: float) -> None:
    """20 M draws: the count of hits is Poisson itself."""
    counts = wp.empty(20_000_000, dtype=wp.int32, device=device)
    launch(poisson_kernel, counts.size, [rate, wp.uint32(5), counts], choose_device(device))
    expected = rate * counts.size
    assert abs(int(counts.numpy().sum()) - expected) < 4.5 * np.sqrt(expected)


def hashed(keys: np.ndarray, device: str) -> np.ndarray:
    source = wp.array(keys.astype(np.uint32), dtype=wp.vec3ui, device=device)
    bits = wp.empty_like(source)
    launch(pcg3d_kernel, len(keys), [source, bits], choose_device(device))
    return bits.numpy()


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_hash_of_consecutive_keys_is_uniform_and_uncorrelated(device: str, axis: int) -> None:
    """Along each counter (splat, stream, point): each output is uniform, and independent of its neighbour's."""
    n = 1 << 18
    keys = np.full((n, 3), 12345, np.uint64)
    keys[:, axis] = np.arange(n)
    unit = hashed(keys, device) / 2.0**32
    cells = 64
    for a in range(3):
        histogram = np.bincount((unit[:, a] * cells * cells).astype(int), minlength=cells * cells)
        assert chi_squared(histogram, np.full(cells * cells, n / cells**2)).p_value > 1e-4
        for shift, b in ((0, (a + 1) % 3), (1, a), (1, (a + 1) % 3), (2, a)):
            left, right = unit[: n - shift, a], unit[shift:, b]
            pairs = (left * cells).astype(int) * cells + (right * cells).astype(int)
            histogram = np.bincount(pairs, minlength=cells * cells)
            assert chi_squared(histogram, np.full(cells * cells, len(left) / cells**2)).p_value > 1e-4


def test_stream_keys_differ() -> None:
    keys = {stream_key(seed, sample, instance) for seed in range(20) for sample in range(200) for instance in range(20)}
    assert len(keys) > 80_000 - 5  # 32-bit birthdays: 0.75 expected
    assert stream_key(1, 0, 0) != stream_key(0, 1, 0) != stream_key(0, 0, 1)
