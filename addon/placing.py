# SPDX-License-Identifier: GPL-3.0-or-later
"""Objects brought to a place in the world, and a sentence where something of theirs would not let them stay there.

Blender takes any world matrix and keeps of it what location, rotation and scale can hold; parents, constraints, keys
and drivers then make another place of these.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from mathutils import Matrix

from ..engine.errors import StippleError
from .animated_paths import slot_curves

TRANSFORM = ("location", "rotation_euler", "rotation_quaternion", "rotation_axis_angle", "scale")
KEYED = {*TRANSFORM, "delta_location", "delta_rotation_euler", "delta_rotation_quaternion", "delta_scale"}
TOLERANCE = 1e-4  # of the object's size and of how far from the origin it or its parent is


def stand_at(b_object: Any, b_matrix: Matrix, where: str, context: Any) -> None:
    """Puts an object where its world matrix is `b_matrix`; `where` says in the sentence what place that is.

    Raises StippleError where it would stand elsewhere, now or at another frame, and leaves it where it was.
    """
    if is_keyed(b_object):
        raise StippleError(f"{b_object.name}: its keyframes would move it away from {where}; remove them first.")
    before = [(name, tuple(getattr(b_object, name))) for name in TRANSFORM]
    b_object.matrix_world = b_matrix
    b_basis = b_object.matrix_basis.copy()
    b_evaluated = b_object.evaluated_get(context.evaluated_depsgraph_get())
    if _is_at(b_evaluated, b_matrix):
        return
    hindrance = _hindrance(b_object, b_evaluated, b_basis, b_matrix, where)
    for name, value in before:
        setattr(b_object, name, value)
    context.view_layer.update()
    raise StippleError(f"{b_object.name}: {hindrance}")


class LetGo:
    """Objects without their parents, standing where they stood, unless something fails in the block: then as before.

    Raises StippleError, when entered, where one of them would stand elsewhere.
    """

    def __init__(self, b_objects: list[Any], context: Any) -> None:
        self._b_objects, self._context = b_objects, context
        self._before: list[tuple[Any, dict[str, Any]]] = []

    def __enter__(self) -> None:
        try:
            for b_object in self._b_objects:
                b_matrix, name = b_object.matrix_world.copy(), b_object.parent.name
                kept = {key: getattr(b_object, key) for key in ("parent", "parent_type", "parent_bone")}
                kept |= {key: tuple(getattr(b_object, key)) for key in ("parent_vertices", *TRANSFORM)}
                kept["matrix_parent_inverse"] = b_object.matrix_parent_inverse.copy()
                self._before.append((b_object, kept))
                b_object.parent = None
                stand_at(b_object, b_matrix, f"where it stands with its parent {name}", self._context)
        except BaseException:
            self._take_back()
            raise

    def __exit__(self, kind: type | None, error: BaseException | None, trace: object) -> None:
        if error is not None:
            self._take_back()

    def _take_back(self) -> None:
        for b_object, kept in self._before:
            for key, value in kept.items():
                setattr(b_object, key, value)
        self._context.view_layer.update()


def is_keyed(b_object: Any) -> bool:
    """Whether keyframes, those of the nonlinear animation included, set an object's location, rotation or scale."""
    return any(b_curve.data_path in KEYED and not b_curve.mute for b_curve in _curves_of(b_object))


def _curves_of(b_object: Any) -> Iterator[Any]:
    b_animation = b_object.animation_data
    if b_animation is None:
        return
    b_strips = [b_strip for b_track in b_animation.nla_tracks if not b_track.mute for b_strip in b_track.strips]
    for b_owner in (b_animation, *b_strips):
        if b_owner.action is not None:
            yield from slot_curves(b_owner.action, b_owner.action_slot)


def _hindrance(b_object: Any, b_evaluated: Any, b_basis: Matrix, b_matrix: Matrix, where: str) -> str:
    """What keeps an object, whose own transform was set to `b_basis`, from standing at a world matrix; what to do."""
    if not _are_close(b_evaluated.matrix_basis, b_basis, 0.0):
        return f"its drivers would move it away from {where}; remove those of its transform first."
    b_parent = b_object.parent
    b_local = b_matrix if b_parent is None else b_parent.matrix_world.inverted_safe() @ b_matrix
    if not _are_close(Matrix.LocRotScale(*b_local.decompose()), b_local, 0.0):
        if b_parent is None:
            return f"it is sheared, and without a parent could not be {where}; apply the scale of its parents first."
        return (
            f"the uneven scale of its parent {b_parent.name} keeps it from {where}; "
            "clear the parent (Clear and Keep Transformation) or apply its scale first."
        )
    names = ", ".join(b_constraint.name for b_constraint in b_object.constraints if not b_constraint.mute)
    what = f"its constraints ({names})" if names else "its parent"
    return f"{what} would move it away from {where}; turn that off first."


def _is_at(b_object: Any, b_matrix: Matrix) -> bool:
    distance = b_object.parent.matrix_world.translation.length if b_object.parent else 0.0
    return _are_close(b_object.matrix_world, b_matrix, distance)


def _are_close(b_found: Matrix, b_wanted: Matrix, distance: float) -> bool:
    found, wanted = np.array(b_found, np.float64)[:3], np.array(b_wanted, np.float64)[:3]
    size = np.abs(wanted[:, :3]).max()
    off = np.abs(found - wanted)
    reach = size + np.abs(wanted[:, 3]).max() + distance
    return bool(off[:, :3].max() <= TOLERANCE * size and off[:, 3].max() <= TOLERANCE * reach)
