# SPDX-License-Identifier: GPL-3.0-or-later
"""Affine maps (3, 4): composed in float64 on the host, applied in float32 on the device.

Composing first lets far-off world coordinates cancel before they are rounded, as in `maths/projection.make_pose`.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import warp as wp

from ..errors import StippleError

wp.set_module_options({"enable_backward": False})

Matrix = npt.NDArray[np.float64]


@wp.struct
class Affine:
    """new = linear · old + translation."""

    linear: wp.mat33
    translation: wp.vec3


@wp.func
def mapped(affine: Affine, p: wp.vec3) -> wp.vec3:
    return affine.linear * p + affine.translation


def checked(matrix: npt.ArrayLike | None, what: str) -> Matrix:
    """A finite map (3, 4) with an inverse; None stands for the identity.

    Raises StippleError, which names `what` it is, for another shape, values not finite, or a map that flattens.
    """
    if matrix is None:
        return np.eye(3, 4)
    given = np.asarray(matrix, np.float64)
    if given.shape not in ((3, 4), (4, 4)) or not np.isfinite(given).all():
        raise StippleError(f"{what} must be a finite 3×4 matrix.")
    if abs(np.linalg.det(given[:3, :3])) < 1e-30:
        raise StippleError(f"{what} flattens the capture; give every axis a scale.")
    return given[:3].copy()


def composed(outer: Matrix, inner: Matrix) -> Matrix:
    """The map that does `inner` and then `outer`."""
    return np.column_stack([outer[:, :3] @ inner[:, :3], outer[:, :3] @ inner[:, 3] + outer[:, 3]])


def inverse(matrix: Matrix) -> Matrix:
    linear = np.linalg.inv(matrix[:, :3])
    return np.column_stack([linear, -linear @ matrix[:, 3]])


def about(linear: npt.ArrayLike, pivot: npt.ArrayLike) -> Matrix:
    """The map with a linear part (3, 3) that leaves `pivot` where it is."""
    linear, pivot = np.asarray(linear, np.float64), np.asarray(pivot, np.float64)
    return np.column_stack([linear, pivot - linear @ pivot])


def device_affine(matrix: Matrix) -> Affine:
    """As kernels take it."""
    affine = Affine()
    affine.linear = wp.mat33(*matrix[:, :3].ravel())
    affine.translation = wp.vec3(*matrix[:, 3])
    return affine
