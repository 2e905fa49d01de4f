# SPDX-License-Identifier: GPL-3.0-or-later
"""Spherical harmonics against integration, the addition theorem, SciPy and the constants 3DGS publishes."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest

from .sh import basis, colour


def sphere_quadrature(order: int) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    """Directions (N, 3) and weights (N,) that integrate polynomials up to degree 2 order − 1 over the sphere."""
    z, weights = np.polynomial.legendre.leggauss(order)
    azimuth = 2 * np.pi * np.arange(2 * order) / (2 * order)
    ring = np.sqrt(1 - z**2)[:, None]
    directions = np.stack(np.broadcast_arrays(ring * np.cos(azimuth), ring * np.sin(azimuth), z[:, None]), axis=-1)
    return directions.reshape(-1, 3), np.repeat(weights * np.pi / order, 2 * order)


def random_directions(seed: int, count: int) -> npt.NDArray[np.float64]:
    v = np.random.default_rng(seed).normal(size=(count, 3))
    return v / np.linalg.norm(v, axis=1, keepdims=True)


def test_orthonormal_over_the_sphere() -> None:
    directions, weights = sphere_quadrature(8)
    values = basis(directions, 4)
    np.testing.assert_allclose((values * weights[:, None]).T @ values, np.eye(25), atol=1e-13)


def test_addition_theorem() -> None:
    a, b = random_directions(1, 50), random_directions(2, 50)
    for band in range(5):
        part = slice(band**2, (band + 1) ** 2)
        legendre = np.polynomial.legendre.Legendre.basis(band)((a * b).sum(axis=1))
        product = (basis(a, 4)[:, part] * basis(b, 4)[:, part]).sum(axis=1)
        np.testing.assert_allclose(product, (2 * band + 1) / (4 * np.pi) * legendre, atol=1e-13)


def test_signs_and_order_of_3dgs() -> None:
    """INRIA's SH_C1, SH_C2 and SH_C3 (utils/sh_utils.py) with their polynomials, at a point off every axis."""
    x, y, z = direction = np.array([2.0, 3.0, 6.0]) / 7.0
    xx, yy, zz = x * x, y * y, z * z
    band_2 = [
        1.0925484305920792 * x * y,
        -1.0925484305920792 * y * z,
        0.31539156525252005 * (2 * zz - xx - yy),
        -1.0925484305920792 * x * z,
        0.5462742152960396 * (xx - yy),
    ]
    band_3 = [
        -0.5900435899266435 * y * (3 * xx - yy),
        2.890611442640554 * x * y * z,
        -0.4570457994644658 * y * (4 * zz - xx - yy),
        0.3731763325901154 * z * (2 * zz - 3 * xx - 3 * yy),
        -0.4570457994644658 * x * (4 * zz - xx - yy),
        1.445305721320277 * z * (xx - yy),
        -0.5900435899266435 * x * (xx - 3 * yy),
    ]
    c1 = 0.4886025119029199
    expected = [0.28209479177387814, -c1 * y, c1 * z, -c1 * x, *band_2, *band_3]
    np.testing.assert_allclose(basis(direction, 3)[0], expected, rtol=1e-14)


def test_band_four_follows_the_complex_harmonics_of_scipy() -> None:
    """SciPy's Y_l^m carries the Condon–Shortley sign: the real one is √2 Re Y_l^m (m > 0) or √2 Im Y_l^|m| (m < 0)."""
    special = pytest.importorskip("scipy.special")
    directions = random_directions(3, 40)
    polar, azimuth = np.arccos(directions[:, 2]), np.arctan2(directions[:, 1], directions[:, 0])
    for order in range(-4, 5):
        value = special.sph_harm_y(4, abs(order), polar, azimuth)
        real = value.real if order == 0 else np.sqrt(2) * (value.imag if order < 0 else value.real)
        np.testing.assert_allclose(basis(directions, 4)[:, 20 + order], real, atol=1e-13)


def test_colour_is_offset_clamped_below_and_cut_at_the_degree() -> None:
    dc = np.array([[0.0, -3.0, 9.0]])
    rest = np.zeros((1, 8, 3))
    rest[0, 1, 0] = 1.0  # Y_1^0 = C1 z
    rest[0, 5, 0] = 1.0  # Y_2^0 = C2 (3 z² − 1)
    up = np.array([[0.0, 0.0, 1.0]])
    c0, c1, c2 = 0.28209479177387814, 0.4886025119029199, 0.31539156525252005 * 2
    np.testing.assert_allclose(colour(dc, rest, up, None), [[0.5 + c1 + c2, 0.0, 0.5 + 9 * c0]])
    np.testing.assert_allclose(colour(dc, rest, up, 1), [[0.5 + c1, 0.0, 0.5 + 9 * c0]])
    np.testing.assert_allclose(colour(dc, rest, up, 0), [[0.5, 0.0, 0.5 + 9 * c0]])
    np.testing.assert_allclose(colour(dc, rest, -up, 4), [[0.5 - c1 + c2, 0.0, 0.5 + 9 * c0]])
    with pytest.raises(ValueError, match="5 coefficients"):
        colour(dc, np.zeros((1, 5, 3)), up, None)
