# SPDX-License-Identifier: GPL-3.0-or-later
"""The dilogarithm against its special values, SciPy and numerical integration."""

from __future__ import annotations

import math

import numpy as np
import pytest

from .dilogarithm import AT_ONE, dilogarithm, inverse_dilogarithm

scipy_special = pytest.importorskip("scipy.special")
LN2 = math.log(2.0)
GOLDEN = (math.sqrt(5.0) - 1.0) / 2.0


@pytest.mark.parametrize(
    ("x", "expected"),
    [
        (0.0, 0.0),
        (1.0, math.pi**2 / 6),
        (-1.0, -(math.pi**2) / 12),
        (0.5, math.pi**2 / 12 - LN2**2 / 2),
        (GOLDEN, math.pi**2 / 10 - math.log(GOLDEN) ** 2),
        (GOLDEN**2, math.pi**2 / 15 - math.log(GOLDEN) ** 2),
        (-GOLDEN, -(math.pi**2) / 15 + math.log(GOLDEN) ** 2 / 2),
    ],
)
def test_special_values(x: float, expected: float) -> None:
    assert dilogarithm(x) == pytest.approx(expected, abs=4e-16)


def test_agrees_with_scipy_over_the_whole_range() -> None:
    x = np.concatenate([np.linspace(-1, 1, 20001), 1 - np.logspace(-16, -1, 200), np.logspace(-300, -1, 200)])
    np.testing.assert_allclose(dilogarithm(x), scipy_special.spence(1.0 - x), rtol=1e-12, atol=1e-15)


def test_agrees_with_its_integral() -> None:
    nodes, weights = np.polynomial.legendre.leggauss(60)
    for x in (0.1, 0.5, 0.9):
        s = 0.5 * x * (nodes + 1)
        assert dilogarithm(x) == pytest.approx(float((0.5 * x * weights * -np.log1p(-s) / s).sum()), abs=1e-13)


def test_inverse_undoes_it() -> None:
    y = np.concatenate([np.linspace(0, AT_ONE, 20001), np.logspace(-300, -1, 200), AT_ONE - np.logspace(-14, -1, 200)])
    x = inverse_dilogarithm(y)
    assert ((x >= 0) & (x <= 1)).all()
    np.testing.assert_allclose(dilogarithm(x), y, rtol=1e-13, atol=1e-14)
    inner = np.linspace(0.0, 0.999, 5001)
    np.testing.assert_allclose(inverse_dilogarithm(dilogarithm(inner)), inner, rtol=1e-12, atol=1e-15)
    assert inverse_dilogarithm(AT_ONE) == 1.0
    assert inverse_dilogarithm(0.0) == 0.0


def test_values_outside_the_range_are_refused() -> None:
    with pytest.raises(ValueError, match="-1 <= x <= 1"):
        dilogarithm(1.5)
    with pytest.raises(ValueError, match="defined"):
        inverse_dilogarithm([0.1, 1.7])
