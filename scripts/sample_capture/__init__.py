# SPDX-License-Identifier: GPL-3.0-or-later
"""The project's own sample capture: fly agarics on a piece of forest floor, as splats.

Textured parametric surfaces are cut into flat Gaussians, lit by each other (sun, sky, one bounce), and their
view-dependent radiance is fitted with spherical harmonics, so the result looks and behaves like a trained capture
without a single photograph.
"""

from __future__ import annotations

import numpy as np

from ...engine.errors import StippleError
from ...engine.splats import SplatCloud
from .composition import compose
from .lighting import SUN_DIRECTION, lit
from .noise import FloatArray, NoiseField
from .surfels import Surfels
from .view_dependence import fitted_sh

OBJECT_FROM_MODEL = np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0]], np.float32)  # z up to y down, a pure rotation

MIN_COUNT = 15_000

__all__ = ["build_sample"]


def build_sample(splat_count: int = 260_000, seed: int = 7) -> SplatCloud:
    """The sample as `splat_count` splats, SH degree 3, sRGB-encoded colour.

    Object space as COLMAP leaves it: x right, y down, z away from the front; the underside is at y = 0, the
    diameter about 2.4 units and the height about 1. Equal arguments give equal arrays on one machine.

    Raises StippleError below MIN_COUNT splats: single blades and needles need about half as many.
    """
    if splat_count < MIN_COUNT:
        raise StippleError(f"sample: {splat_count} splats are too few to show it; ask for at least {MIN_COUNT}.")
    rng = np.random.default_rng(seed)
    noise = NoiseField(rng)
    made = compose(splat_count, noise, rng)
    sh = fitted_sh(made, lit(made, noise, rng), SUN_DIRECTION, OBJECT_FROM_MODEL)
    return SplatCloud(
        position=np.ascontiguousarray(made.position @ OBJECT_FROM_MODEL.T),
        scale=np.ascontiguousarray(made.scale),
        rotation=quaternions(made),
        opacity=np.ascontiguousarray(made.opacity),
        sh_dc=np.ascontiguousarray(sh[:, 0]),
        sh_rest=np.ascontiguousarray(sh[:, 1:]),
        name="forest floor",
    )


def quaternions(made: Surfels) -> FloatArray:
    """Unit quaternions (N, 4: w, x, y, z) that turn x, y, z into tangent, normal × tangent, normal in object space."""
    tangent, normal = made.tangent @ OBJECT_FROM_MODEL.T, made.normal @ OBJECT_FROM_MODEL.T
    x, y, z = tangent.T, np.cross(normal, tangent).T, normal.T
    # Shepperd (1978): of the four equivalent formulas take the one with the largest divisor.
    squares = np.stack([x[0] + y[1] + z[2], x[0] - y[1] - z[2], y[1] - x[0] - z[2], z[2] - x[0] - y[1]])
    candidates = np.stack(
        [
            [1 + squares[0], y[2] - z[1], z[0] - x[2], x[1] - y[0]],
            [y[2] - z[1], 1 + squares[1], x[1] + y[0], z[0] + x[2]],
            [z[0] - x[2], x[1] + y[0], 1 + squares[2], y[2] + z[1]],
            [x[1] - y[0], z[0] + x[2], y[2] + z[1], 1 + squares[3]],
        ]
    )
    chosen = candidates[squares.argmax(axis=0), :, np.arange(len(made))]
    return np.ascontiguousarray(chosen / np.linalg.norm(chosen, axis=1, keepdims=True), np.float32)
