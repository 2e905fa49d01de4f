# SPDX-License-Identifier: GPL-3.0-or-later
"""Add and remove crops of a capture."""

from __future__ import annotations

from typing import Any

import bpy
import numpy as np
from bpy.props import BoolProperty, EnumProperty, IntProperty
from mathutils import Matrix

from ...engine.look import MOST_CROPS
from ..object_properties import KEEPS, SHAPES
from ..splat_data import is_capture_object

EMPTY_SHAPES = {"BOX": "CUBE", "SPHERE": "SPHERE"}
SHARE = {"INSIDE": 1.001, "OUTSIDE": 0.5}  # of the bounds in a new crop: hiding all would leave nothing to see


class OBJECT_OT_stipple_crop_add(bpy.types.Operator):
    """Crop the active capture by a new empty, or by the other selected objects"""

    bl_idname = "object.stipple_crop_add"
    bl_label = "Add Crop"
    bl_options = {"REGISTER", "UNDO"}  # noqa: RUF012 - Blender reads a set here

    shape: EnumProperty(name="Shape", description="Volume that crops", items=SHAPES, default="BOX")  # type: ignore[valid-type]
    keep: EnumProperty(name="Keep", description="Side of the volume that is shown", items=KEEPS, default="INSIDE")  # type: ignore[valid-type]
    use_selected: BoolProperty(  # type: ignore[valid-type]
        name="Selected Objects", description="Crop by the other selected objects instead of a new empty", default=False
    )
    parent: BoolProperty(  # type: ignore[valid-type]
        name="Parent", description="Let the new empty move with the capture", default=True
    )

    @classmethod
    def poll(cls, context: Any) -> bool:
        if not is_capture_object(context.object):
            cls.poll_message_set("Select a capture")
            return False
        return True

    def execute(self, context: Any) -> set[str]:
        b_object = context.object
        b_volumes = (
            [b_other for b_other in context.selected_objects if b_other != b_object] if self.use_selected else []
        )
        if self.use_selected and not b_volumes:
            self.report({"ERROR"}, f"{b_object.name}: select the objects to crop by too, the capture last.")
            return {"CANCELLED"}
        room = MOST_CROPS - len(b_object.stipple.crops)
        if room < max(1, len(b_volumes)):
            self.report({"ERROR"}, f"{b_object.name}: a capture has at most {MOST_CROPS} crops; remove some first.")
            return {"CANCELLED"}
        for b_volume in b_volumes or [self._new_empty(b_object)]:
            b_crop = b_object.stipple.crops.add()
            b_crop.object, b_crop.shape, b_crop.keep = b_volume, self.shape, self.keep
        b_object.stipple.active_crop = len(b_object.stipple.crops) - 1
        return {"FINISHED"}

    def _new_empty(self, b_object: Any) -> Any:
        """An empty around the capture's bounding box, in its collections."""
        corners = np.array(b_object.bound_box)
        half = (corners.max(axis=0) - corners.min(axis=0)) / 2 * SHARE[self.keep]
        local = Matrix.Translation(corners.mean(axis=0)) @ Matrix.Diagonal((*np.maximum(half, 1e-6), 1.0))
        b_empty = bpy.data.objects.new(f"{b_object.name} Crop", None)
        b_empty.empty_display_type, b_empty.empty_display_size = EMPTY_SHAPES[self.shape], 1.0
        for b_collection in b_object.users_collection:
            b_collection.objects.link(b_empty)
        if self.parent:
            b_empty.parent, b_empty.matrix_basis = b_object, local
        else:
            b_empty.matrix_basis = b_object.matrix_world @ local
        return b_empty


class OBJECT_OT_stipple_crop_remove(bpy.types.Operator):
    """Remove a crop of the active capture; the object it crops by stays"""

    bl_idname = "object.stipple_crop_remove"
    bl_label = "Remove Crop"
    bl_options = {"REGISTER", "UNDO"}  # noqa: RUF012 - Blender reads a set here

    index: IntProperty(  # type: ignore[valid-type]
        name="Index", description="Which crop, from 0; -1 for the active one", default=-1, min=-1
    )

    @classmethod
    def poll(cls, context: Any) -> bool:
        return is_capture_object(context.object) and len(context.object.stipple.crops) > 0

    def execute(self, context: Any) -> set[str]:
        b_object = context.object
        b_stipple = b_object.stipple
        index = b_stipple.active_crop if self.index < 0 else self.index
        if index >= len(b_stipple.crops):
            self.report({"ERROR"}, f"{b_object.name}: there is no crop {index}; it has {len(b_stipple.crops)}.")
            return {"CANCELLED"}
        b_stipple.crops.remove(index)
        b_stipple.active_crop = min(b_stipple.active_crop, max(0, len(b_stipple.crops) - 1))
        b_object.update_tag(refresh={"OBJECT"})
        return {"FINISHED"}


CLASSES = (OBJECT_OT_stipple_crop_add, OBJECT_OT_stipple_crop_remove)


def register() -> None:
    for cls in CLASSES:
        bpy.utils.register_class(cls)


def unregister() -> None:
    for cls in reversed(CLASSES):
        bpy.utils.unregister_class(cls)
