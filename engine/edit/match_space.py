# SPDX-License-Identifier: GPL-3.0-or-later
"""Find splats by where their means are in the world: in a ball, in a box, on one side of a plane.

Every splat is tested, without a spatial index (Splatshop §3.1: brute force is fast enough and never out of date). The
flags of a splat play no part here; `selection` looks at them.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import warp as wp

from ..device import launch
from ..errors import StippleError
from .affine import Affine, Matrix, checked, composed, device_affine, inverse, mapped
from .editable_cloud import EditableCloud
from .mask import Mask, mask_from_hits

wp.set_module_options({"enable_backward": False})

BALL, BOX, HALF_SPACE = 0, 1, 2


@wp.kernel
def match_shape_kernel(
    first: wp.int32,
    position: wp.array(dtype=wp.vec3),
    unit_from_object: Affine,  # to where the shape is the unit ball, the cube -1 … 1 or z >= 0
    shape: wp.int32,
    hits: wp.array(dtype=wp.uint8),
) -> None:
    i = first + wp.tid()
    p = mapped(unit_from_object, position[i])
    inside = p[2] >= 0.0
    if shape == BALL:
        inside = wp.dot(p, p) <= 1.0
    elif shape == BOX:
        inside = wp.max(wp.abs(p)) <= 1.0
    hits[i] = wp.uint8(wp.where(inside, 1, 0))


def match_sphere(
    cloud: EditableCloud, centre: npt.ArrayLike, radius: float, world_from_object: npt.ArrayLike | None = None
) -> Mask:
    """Splats whose mean is within `radius` of `centre` (3,), both in world units.

    Raises StippleError for a radius that is not positive or a matrix that flattens.
    """
    unit_from_world = unit_ball_from_world(centre, radius)
    return _match(cloud, BALL, composed(unit_from_world, checked(world_from_object, "world_from_object")))


def match_box(
    cloud: EditableCloud, world_from_box: npt.ArrayLike, world_from_object: npt.ArrayLike | None = None
) -> Mask:
    """Splats whose mean is in the cube -1 … 1 of the space that `world_from_box` (3, 4) maps to the world.

    The box may be turned and sheared: an empty of Blender's is such a matrix. Raises StippleError for a flat box.
    """
    box_from_world = inverse(checked(world_from_box, "the selection box"))
    return _match(cloud, BOX, composed(box_from_world, checked(world_from_object, "world_from_object")))


def match_bounds(
    cloud: EditableCloud,
    low: npt.ArrayLike,
    high: npt.ArrayLike,
    world_from_object: npt.ArrayLike | None = None,
) -> Mask:
    """Splats whose mean is between two corners (3,) along the world's axes. Raises StippleError for an empty box."""
    low, high = np.asarray(low, np.float64), np.asarray(high, np.float64)
    if not (low < high).all():
        raise StippleError(f"selection box: corners {low} and {high} enclose nothing; give each axis a width.")
    return match_box(cloud, np.column_stack([np.diag((high - low) / 2), (high + low) / 2]), world_from_object)


def match_half_space(
    cloud: EditableCloud,
    point: npt.ArrayLike,
    normal: npt.ArrayLike,
    world_from_object: npt.ArrayLike | None = None,
) -> Mask:
    """Splats whose mean is on the plane through `point` or on the side that `normal` points to, in the world.

    Raises StippleError for a normal of no length.
    """
    point, normal = np.asarray(point, np.float64), np.asarray(normal, np.float64)
    length = np.linalg.norm(normal)
    if not (np.isfinite(length) and length > 0 and np.isfinite(point).all()):
        raise StippleError("selection plane: the normal has no direction; give one that is not zero.")
    row = normal / length
    height_from_world = np.zeros((3, 4))
    height_from_world[2] = [*row, -row @ point]
    return _match(cloud, HALF_SPACE, composed(height_from_world, checked(world_from_object, "world_from_object")))


def unit_ball_from_world(centre: npt.ArrayLike, radius: float) -> Matrix:
    """The map that makes a sphere the unit ball. Raises StippleError for one that is none."""
    centre = np.asarray(centre, np.float64)
    if not (np.isfinite(centre).all() and np.isfinite(radius) and radius > 0):
        raise StippleError(f"sphere: radius {radius} at {centre}; give finite values and a radius above 0.")
    return np.column_stack([np.eye(3), -centre]) / radius


def _match(cloud: EditableCloud, shape: int, unit_from_object: Matrix) -> Mask:
    hits = cloud.hits()
    inputs = [cloud.array("position"), device_affine(unit_from_object), shape, hits]
    launch(match_shape_kernel, cloud.splat_count, inputs, cloud.device)
    return mask_from_hits(hits, cloud.splat_count)
