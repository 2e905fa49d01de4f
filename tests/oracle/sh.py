# SPDX-License-Identifier: GPL-3.0-or-later
"""Real spherical harmonics up to degree 4 as 3DGS and gsplat order and sign them, in float64.

Computed from Legendre polynomials instead of the expanded polynomials that renderers carry, so that a wrong
constant there cannot hide here.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
from numpy.polynomial.legendre import Legendre

from .scene_like import Float64Array

MAX_DEGREE = 4


def basis(directions: npt.ArrayLike, degree: int) -> Float64Array:
    """Real SH at unit directions (N, 3): (N, (degree + 1)²) float64, index l (l + 1) + m.

    For m > 0 it is (−1)^m √2 K_lm Re(x + iy)^m d^m P_l(z)/dz^m, for m < 0 the same with |m| and the imaginary
    part; K_lm = √((2l + 1)/(4π) (l − m)!/(l + m)!). The factor (−1)^m (Condon–Shortley) is what makes band 1
    (−y, z, −x) in 3DGS. (Sloan, "Efficient Spherical Harmonic Evaluation", 2013.)
    """
    x, y, z = np.atleast_2d(np.asarray(directions, dtype=np.float64)).T
    columns: list[Float64Array] = []
    for band in range(degree + 1):
        for order in range(-band, band + 1):
            m = abs(order)
            ratio = math.factorial(band - m) / math.factorial(band + m)
            norm = math.sqrt((2 * band + 1) / (4 * math.pi) * ratio) * (math.sqrt(2.0) if m else 1.0) * (-1) ** m
            legendre = Legendre.basis(band).deriv(m)(z) if m else Legendre.basis(band)(z)
            azimuth = (x + 1j * y) ** m
            columns.append(norm * legendre * (azimuth.imag if order < 0 else azimuth.real))
    return np.stack(columns, axis=1)


def colour(sh_dc: npt.ArrayLike, sh_rest: npt.ArrayLike, directions: npt.ArrayLike, degree: int | None) -> Float64Array:
    """Colours (N, 3), sRGB-encoded: max(0, 0.5 + Σ coefficient · basis); not clamped above.

    `sh_dc` (N, 3); `sh_rest` (N, C, 3) with C = 0, 3, 8, 15 or 24; `directions` (N, 3) unit vectors from the camera
    to the mean, in object space. Bands above `degree` are left out (None: none are).
    """
    rest = np.asarray(sh_rest, dtype=np.float64)
    held = math.isqrt(rest.shape[1] + 1) - 1
    if (held + 1) ** 2 != rest.shape[1] + 1 or held > MAX_DEGREE:
        raise ValueError(f"sh_rest has {rest.shape[1]} coefficients per channel: no complete degree from 0 to 4")
    used = held if degree is None else min(held, degree)
    dc = np.asarray(sh_dc, dtype=np.float64)[:, None, :]
    coefficients = np.concatenate([dc, rest[:, : (used + 1) ** 2 - 1]], axis=1)
    return np.asarray(np.maximum(0.0, 0.5 + np.einsum("nk,nkc->nc", basis(directions, used), coefficients)))
