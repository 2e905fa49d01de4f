# SPDX-License-Identifier: GPL-3.0-or-later
"""Bake an affine map into a cloud: means, scales, rotations and view-dependent colour."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt

from ..errors import StippleError
from ..splats import SplatCloud
from .sh_rotation import rotate_sh

Matrix = npt.NDArray[np.float64]

BLOCK = 1 << 17  # splats at a time: bounds the float64 intermediates to some 40 MB


def transform_cloud(cloud: SplatCloud, new_from_old: Matrix) -> SplatCloud:
    """The cloud whose picture, untransformed, is that of `cloud` under `new_from_old` (3, 4).

    Exact for rotation, uniform scale, mirroring and translation, to the rounding of float32. Uneven scale and shear are
    exact for means and shapes (the covariance is carried through and diagonalised again); view-dependent colour then
    follows the rotation next to the map (its polar factor), because no harmonics of finite degree could follow the map
    itself.

    Raises StippleError when the map is not finite or flattens the cloud.
    """
    matrix = np.asarray(new_from_old, np.float64)
    linear, translation = matrix[:, :3], matrix[:, 3]
    if not np.isfinite(matrix).all() or abs(np.linalg.det(linear)) < 1e-30:
        raise StippleError(f"{cloud.name}: the transform flattens the capture; give every axis a scale.")
    nearest = polar_rotation(linear)
    scale, rotation = np.empty_like(cloud.scale), np.empty_like(cloud.rotation)
    for first in range(0, cloud.splat_count, BLOCK):
        rows = slice(first, first + BLOCK)
        scale[rows], rotation[rows] = _transform_shapes(cloud.scale[rows], cloud.rotation[rows], linear)
    position = cloud.position.astype(np.float64) @ linear.T + translation
    sh_rest = rotate_sh(cloud.sh_rest, nearest, cloud.sh_degree) if cloud.sh_degree else cloud.sh_rest
    return replace(
        cloud,
        position=position.astype(np.float32),
        scale=scale,
        rotation=rotation,
        sh_rest=np.ascontiguousarray(sh_rest),
    )


def polar_rotation(linear: Matrix) -> Matrix:
    """The orthogonal matrix next to `linear` (3, 3); it mirrors where `linear` does."""
    u, _, vt = np.linalg.svd(linear)
    return u @ vt


def _transform_shapes(
    scale: npt.NDArray[np.float32], rotation: npt.NDArray[np.float32], linear: Matrix
) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.float32]]:
    """Scales and unit quaternions of the mapped ellipsoids.

    A map that is a rotation times a uniform scale turns the axes and keeps their order; any other needs the singular
    values of (linear · axes · scales), whose squares are the new covariance's eigenvalues.
    """
    axes = matrices_from_quaternions(rotation.astype(np.float64))
    factor = np.cbrt(abs(np.linalg.det(linear)))
    nearest = polar_rotation(linear)
    if np.allclose(linear, factor * nearest, atol=1e-7 * factor):
        turn = nearest if np.linalg.det(nearest) > 0 else -nearest  # an ellipsoid is its own point reflection
        return (scale * np.float32(factor)).astype(np.float32), quaternions_from_matrices(turn @ axes).astype(
            np.float32
        )
    u, singular, _ = np.linalg.svd(linear @ axes * scale.astype(np.float64)[:, None, :])
    u[np.linalg.det(u) < 0] *= -1
    return singular.astype(np.float32), quaternions_from_matrices(u).astype(np.float32)


def matrices_from_quaternions(quaternion: Matrix) -> Matrix:
    """Unit quaternions w, x, y, z (N, 4) to rotation matrices (N, 3, 3)."""
    w, x, y, z = quaternion.T
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def quaternions_from_matrices(matrix: Matrix) -> Matrix:
    """Rotation matrices (N, 3, 3) to unit quaternions w, x, y, z (N, 4) with w >= 0.

    Takes the largest of the four components first, so that no division is by a small number.
    """
    m = matrix
    trace = m[:, 0, 0] + m[:, 1, 1] + m[:, 2, 2]
    diagonal = np.stack([trace, m[:, 0, 0], m[:, 1, 1], m[:, 2, 2]], axis=1)
    # Column k of each table is 4 · q_k · (w, x, y, z).
    w = np.stack([1 + trace, m[:, 2, 1] - m[:, 1, 2], m[:, 0, 2] - m[:, 2, 0], m[:, 1, 0] - m[:, 0, 1]], axis=1)
    x = np.stack([w[:, 1], 1 + 2 * m[:, 0, 0] - trace, m[:, 0, 1] + m[:, 1, 0], m[:, 0, 2] + m[:, 2, 0]], axis=1)
    y = np.stack([w[:, 2], x[:, 2], 1 + 2 * m[:, 1, 1] - trace, m[:, 1, 2] + m[:, 2, 1]], axis=1)
    z = np.stack([w[:, 3], x[:, 3], y[:, 3], 1 + 2 * m[:, 2, 2] - trace], axis=1)
    chosen = np.stack([w, x, y, z], axis=1)[np.arange(len(m)), diagonal.argmax(axis=1)]
    chosen /= np.linalg.norm(chosen, axis=1, keepdims=True)
    return np.where(chosen[:, :1] < 0, -chosen, chosen)
