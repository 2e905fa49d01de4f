# SPDX-License-Identifier: GPL-3.0-or-later
"""Fit the polynomials of engine/maths/dilogarithm.py and print them with their largest errors.

Gaussian Point Splatting (doi 10.1145/3811272) §3.4 fits Li2 with one polynomial of degree 7 (7.27e-5) and its inverse
with one of degree 10 (7.07e-5). Here Li2 takes Euler's reflection on top and is exact to single precision; the inverse
keeps the paper's degree, with no constant term, so that faint splats stay faint, and gets one Newton step on top.
Iteratively reweighted least squares (Lawson) drives the fits to the minimax solution.

    .venv/bin/python scripts/fit_dilogarithm.py
"""

import numpy as np
from scipy.special import spence


def minimax_without_constant(x: np.ndarray, y: np.ndarray, degree: int, sweeps: int = 400) -> np.ndarray:
    """Coefficients of x¹ … x^degree of the polynomial through 0 with the least largest |error| over the samples."""
    basis = np.stack([x**k for k in range(1, degree + 1)], axis=1)
    scale = np.abs(basis).max(axis=0)
    weights = np.full(len(x), 1.0 / len(x))
    best, best_error = np.zeros(degree), np.inf
    for _ in range(sweeps):
        root = np.sqrt(weights)
        solution = np.linalg.lstsq(basis / scale * root[:, None], y * root, rcond=None)[0] / scale
        error = np.abs(basis @ solution - y)
        if error.max() < best_error:
            best, best_error = solution, error.max()
        weights *= error / error.max() + 1e-3
        weights /= weights.sum()
    return best


def report(name: str, coefficients: np.ndarray, x: np.ndarray, y: np.ndarray) -> None:
    error = np.abs(sum(c * x ** (k + 1) for k, c in enumerate(coefficients)) - y)
    print(f"{name} = {[float(f'{c:.9g}') for c in coefficients]}  # largest absolute error {error.max():.3g}")


def main() -> None:
    # Chebyshev-spaced samples resolve the ends, where the error peaks.
    nodes = 0.5 - 0.5 * np.cos(np.linspace(0, np.pi, 6001))
    half = np.clip(nodes / 2, 1e-12, 0.5)
    report("LI2_LOWER_HALF", minimax_without_constant(half, spence(1 - half), 9), half, spence(1 - half))
    s = np.clip(nodes, 1e-12, 1 - 1e-12)
    report("LI2_INVERSE", minimax_without_constant(spence(1 - s), s, 10), spence(1 - s), s)


if __name__ == "__main__":
    main()
