# SPDX-License-Identifier: GPL-3.0-or-later
"""Rotate spherical harmonics: what a capture's view-dependent colour becomes when its splats are turned.

A band of degree l mixes only with itself, by a (2l+1)² orthogonal matrix (Wigner's D in the real basis). It is found by
evaluating the band at 2l+1 or more directions before and after the turn and solving for the matrix: exact, since the
band is a space of polynomials, to the rounding of float64, and free of the sign conventions of closed formulas.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ..splats import MAX_SH_DEGREE

Matrix = npt.NDArray[np.float64]

DIRECTION_COUNT = 64  # over-determined: the condition number of every band stays below 2


def band_matrices(rotation: Matrix, degree: int) -> list[Matrix]:
    """(2l+1, 2l+1) matrices for bands l = 1 … degree: new coefficients = matrix @ old ones.

    `rotation` (3, 3) turns directions of the old object space into those of the new one; it may mirror. Colour seen
    from direction d before equals colour seen from rotation @ d after. Raises ValueError for a matrix that is not
    orthogonal to 1e-6.
    """
    if not np.allclose(rotation @ rotation.T, np.eye(3), atol=1e-6):
        raise ValueError("rotation must be orthogonal")
    directions = _spread_directions(DIRECTION_COUNT)
    turned = directions @ rotation.T
    return [
        np.linalg.lstsq(_band(turned, band), _band(directions, band), rcond=None)[0] for band in range(1, degree + 1)
    ]


def rotate_sh(sh_rest: npt.NDArray[np.float32], rotation: Matrix, degree: int) -> npt.NDArray[np.float32]:
    """Coefficients (N, C, 3) of bands 1 … degree after turning the splats by `rotation`; a new array."""
    if degree > MAX_SH_DEGREE:
        raise ValueError(f"degree {degree} is above {MAX_SH_DEGREE}")
    rotated = np.empty_like(sh_rest)
    first = 0
    for band, matrix in enumerate(band_matrices(rotation, degree), start=1):
        rows = slice(first, first + 2 * band + 1)
        rotated[:, rows] = np.einsum("ij,njc->nic", matrix, sh_rest[:, rows])
        first = rows.stop
    return rotated


def _spread_directions(count: int) -> Matrix:
    """Unit vectors (count, 3) on a Fibonacci spiral."""
    z = 1.0 - (2.0 * np.arange(count) + 1.0) / count
    angle = np.pi * (3.0 - np.sqrt(5.0)) * np.arange(count)
    ring = np.sqrt(1.0 - z * z)
    return np.stack([ring * np.cos(angle), ring * np.sin(angle), z], axis=1)


def _band(directions: Matrix, band: int) -> Matrix:
    """Basis functions (N, 2·band + 1) in the order and with the signs of `maths/sh.py`, up to a common factor."""
    x, y, z = directions.T
    xx, yy, zz = x * x, y * y, z * z
    root = np.sqrt
    bands = {
        1: (-y, z, -x),
        2: (x * y, -y * z, (2 * zz - xx - yy) / root(12), -x * z, (xx - yy) / 2),
        3: (
            -y * (3 * xx - yy) * root(5 / 8),
            x * y * z * root(15),
            -y * (4 * zz - xx - yy) * root(3 / 8),
            z * (2 * zz - 3 * xx - 3 * yy) / 2,
            -x * (4 * zz - xx - yy) * root(3 / 8),
            z * (xx - yy) * root(15) / 2,
            -x * (xx - 3 * yy) * root(5 / 8),
        ),
        4: (
            x * y * (xx - yy) * root(35) / 2,
            -y * z * (3 * xx - yy) * root(35 / 8),
            x * y * (7 * zz - 1) * root(5) / 2,
            -y * z * (7 * zz - 3) * root(5 / 8),
            (zz * (35 * zz - 30) + 3) / 8,
            -x * z * (7 * zz - 3) * root(5 / 8),
            (xx - yy) * (7 * zz - 1) * root(5) / 4,
            -x * z * (xx - 3 * yy) * root(35 / 8),
            (xx * (xx - 3 * yy) - yy * (3 * xx - yy)) * root(35) / 8,
        ),
    }
    return np.stack(bands[band], axis=1)
