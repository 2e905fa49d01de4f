# SPDX-License-Identifier: GPL-3.0-or-later
"""Object > Apply > Splat Transform: bake the object's transform into its splats without changing how they look."""

from __future__ import annotations

from typing import Any

import bpy
import numpy as np
from bpy.props import BoolProperty
from mathutils import Matrix

from ...engine.errors import StippleError
from ..animated_paths import animated_paths
from ..linked_capture import is_linked
from ..sequence import plays
from ..splat_data import cloud_from_datablock, is_capture_object, write_cloud

TURNS = (
    *("rotation_euler", "rotation_quaternion", "rotation_axis_angle", "scale"),
    *("delta_rotation_euler", "delta_rotation_quaternion", "delta_scale"),
)
MOVES = ("location", "delta_location")
UNEVEN = 1e-3  # excess of the largest scale over the smallest from which the colors differ visibly
UNEVEN_COLORS = "its scale was uneven, so its view-dependent color is approximate now; undo to have it exact again."


class OBJECT_OT_stipple_apply_transform(bpy.types.Operator):
    """Apply the object's rotation and scale to its splats, shapes and view-dependent color included"""

    bl_idname = "object.stipple_apply_transform"
    bl_label = "Apply Splat Transform"
    bl_options = {"REGISTER", "UNDO"}  # noqa: RUF012 - Blender reads a set here

    location: BoolProperty(  # type: ignore[valid-type]
        name="Location", description="Also move the splats, and the object to the origin", default=True
    )

    @classmethod
    def poll(cls, context: Any) -> bool:
        if context.mode != "OBJECT" or not any(map(is_capture_object, context.selected_objects)):
            cls.poll_message_set("Select a capture in Object Mode")
            return False
        return True

    def execute(self, context: Any) -> set[str]:
        """All selected captures or none: the new splats are made before the first old one is replaced."""
        b_objects = [b_object for b_object in context.selected_objects if is_capture_object(b_object)]
        try:
            baked = [(b_object, *_bake(b_object, self.location)) for b_object in b_objects]
        except StippleError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        for b_object, applied, cloud in baked:
            write_cloud(b_object.data, cloud)
            _clear_transform(b_object, applied, self.location)
            if cloud.sh_degree and _is_uneven(applied):
                self.report({"WARNING"}, f"{b_object.name}: {UNEVEN_COLORS}")
        return {"FINISHED"}


def _bake(b_object: Any, with_location: bool) -> tuple[Matrix, Any]:
    """The matrix that is baked and the cloud it makes; changes nothing. Raises StippleError for unsuitable data."""
    from ...engine.edit.transform import transform_cloud

    _refuse_unsuitable(b_object, with_location)
    applied = b_object.matrix_basis.copy()
    if not with_location:
        applied.translation = (0.0, 0.0, 0.0)
    cloud, dropped = cloud_from_datablock(b_object.data, b_object.name)
    if cloud is None or dropped:
        raise StippleError(f"{b_object.name}: {dropped} splats have invalid values; delete them first.")

    return applied, transform_cloud(cloud, np.array(applied)[:3])


def _refuse_unsuitable(b_object: Any, with_location: bool) -> None:
    """Raises StippleError where the splats cannot be changed, or the picture would change with them."""
    name, b_data = b_object.name, b_object.data
    if not b_data.is_editable:
        raise StippleError(f"{name}: its data is linked from another file; make it local first.")
    if is_linked(b_data):
        raise StippleError(f"{name}: its splats are in a linked file, which Blender does not change.")
    if plays(b_object):
        raise StippleError(
            f"{name}: it plays a sequence of files, which stay as they are; turn the sequence off to apply to the "
            "object's own splats."
        )
    users = b_data.users - b_data.use_fake_user
    if users > 1:
        raise StippleError(f"{name}: its data has {users} users; use Object > Relations > Make Single User first.")
    animated = animated_paths(b_object)
    if keyed := [path for path in TURNS + MOVES * with_location if path in animated]:
        raise StippleError(
            f"{name}: its {', '.join(keyed)} is keyed or driven and would act on the new splats again; clear it first."
        )


def _is_uneven(applied: Matrix) -> bool:
    """Whether directions from which splats are seen change by more than a turn, which harmonics cannot follow."""
    scales = np.linalg.svd(np.array(applied)[:3, :3], compute_uv=False)
    return bool(scales[0] > (1 + UNEVEN) * scales[-1])


def _clear_transform(b_object: Any, applied: Matrix, with_location: bool) -> None:
    """Takes `applied` out of the object and leaves its children where they are."""
    location = b_object.matrix_basis.translation - applied.translation
    if with_location:  # else both locations stay, for either may be keyed
        b_object.delta_location = (0.0, 0.0, 0.0)
    b_object.delta_rotation_euler = (0.0, 0.0, 0.0)
    b_object.delta_rotation_quaternion = (1.0, 0.0, 0.0, 0.0)
    b_object.delta_scale = (1.0, 1.0, 1.0)
    b_object.matrix_basis = Matrix.Translation(location)
    for b_child in b_object.children:
        b_child.matrix_parent_inverse = applied @ b_child.matrix_parent_inverse


def _draw_menu_entry(self: Any, context: Any) -> None:
    self.layout.separator()
    self.layout.operator(OBJECT_OT_stipple_apply_transform.bl_idname, text="Splat Transform")


def register() -> None:
    bpy.utils.register_class(OBJECT_OT_stipple_apply_transform)
    bpy.types.VIEW3D_MT_object_apply.append(_draw_menu_entry)


def unregister() -> None:
    bpy.types.VIEW3D_MT_object_apply.remove(_draw_menu_entry)
    bpy.utils.unregister_class(OBJECT_OT_stipple_apply_transform)
