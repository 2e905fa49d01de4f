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


def in_object_space(matrix: Matrix, world_from_object: npt.ArrayLike | None) -> Matrix:
    """A map of the world as a map of object space."""
    if world_from_object is None:
        return matrix
    placed = checked(world_from_object, "world_from_object")
    return composed(inverse(placed), composed(matrix, placed))


def about(linear: npt.ArrayLike, pivot: npt.ArrayLike) -> Matrix:
    """The map with a linear part (3, 3) that leaves `pivot` where it is."""
    linear, pivot = np.asarray(linear, np.float64), np.asarray(pivot, np.float64)
    return np.column_stack([linear, pivot - linear @ pivot])


def translation(offset: npt.ArrayLike) -> Matrix:
    """A move by `offset` (3,)."""
    return np.column_stack([np.eye(3), np.asarray(offset, np.float64)])


def rotation(axis: npt.ArrayLike, angle: float, pivot: npt.ArrayLike = (0.0, 0.0, 0.0)) -> Matrix:
    """A turn about `axis` (3,) by `angle` [rad], anticlockwise as seen from where the axis points to.

    Raises StippleError for an axis of no length.
    """
    axis = np.asarray(axis, np.float64)
    length = np.linalg.norm(axis)
    if not (np.isfinite(length) and length > 0 and np.isfinite(angle)):
        raise StippleError("rotation: the axis has no direction; give one that is not zero.")
    x, y, z = axis / length
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return about(np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross, pivot)


def scaling(factors: npt.ArrayLike, pivot: npt.ArrayLike = (0.0, 0.0, 0.0)) -> Matrix:
    """A scale by one factor or by one along each axis (3,)."""
    return about(np.diag(np.broadcast_to(np.asarray(factors, np.float64), 3)), pivot)


def mirroring(normal: npt.ArrayLike, point: npt.ArrayLike = (0.0, 0.0, 0.0)) -> Matrix:
    """A reflection in the plane through `point` across `normal` (3,). Raises StippleError for a normal of no length."""
    normal = np.asarray(normal, np.float64)
    length = np.linalg.norm(normal)
    if not (np.isfinite(length) and length > 0):
        raise StippleError("mirror: the normal has no direction; give one that is not zero.")
    unit = normal / length
    return about(np.eye(3) - 2 * np.outer(unit, unit), point)


def shearing(
    along: npt.ArrayLike, across: npt.ArrayLike, factor: float, pivot: npt.ArrayLike = (0.0, 0.0, 0.0)
) -> Matrix:
    """Moves along one unit vector (3,) by `factor` for every unit of length along another.

    Raises StippleError for vectors that are not square to each other: what they give is a scale besides.
    """
    along, across = np.asarray(along, np.float64), np.asarray(across, np.float64)
    if not (abs(along @ across) < 1e-6 and np.isfinite(factor)):
        raise StippleError("shear: it moves along one axis and leans another; choose two different axes.")
    return about(np.eye(3) + factor * np.outer(along, across), pivot)


def device_affine(matrix: Matrix) -> Affine:
    """As kernels take it."""
    affine = Affine()
    affine.linear = wp.mat33(*matrix[:, :3].ravel())
    affine.translation = wp.vec3(*matrix[:, 3])
    return affine
