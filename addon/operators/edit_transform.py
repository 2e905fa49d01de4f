# SPDX-License-Identifier: GPL-3.0-or-later
"""Move, rotate, scale, mirror and shear the selected splats; G, R and S follow the mouse, axis keys and numbers."""

from __future__ import annotations

import math
from typing import Any, ClassVar

import bpy
import numpy as np
from bpy.props import EnumProperty, FloatProperty, FloatVectorProperty

from ..edit.drag import DragOperator
from ..edit.operator import SplatOperator, world_from_object
from ..edit.session import EditSession

AXES = (("X", "X", ""), ("Y", "Y", ""), ("Z", "Z", ""))
STEEPEST = math.radians(89)  # of a shear; at 90 degrees nothing would be left of it
PIVOTS = (
    ("MEDIAN", "Median Point", "Middle of the selected splats"),
    ("CURSOR", "3D Cursor", "The 3D cursor"),
    ("ORIGIN", "Origin", "The object's origin"),
)


class TransformOperator(SplatOperator):
    """Maps the selection; subclasses say in `matrix` how, in the world, and what that is called."""

    verb: ClassVar[str]

    def step(self, context: Any, session: EditSession) -> Any:
        from ...engine.edit.transform import transform

        matrix = self.matrix(self.pivot_of(context, session))
        placed, name = world_from_object(context), self.bl_label  # type: ignore[attr-defined]
        return transform(session.cloud, matrix, placed, name=name, keep_values=True)

    def matrix(self, pivot: np.ndarray) -> np.ndarray:
        raise NotImplementedError

    def pivot_of(self, context: Any, session: EditSession) -> np.ndarray:
        """The fixed point in the world. Raises StippleError when nothing is selected."""
        from ...engine.edit.pivot import median
        from ...engine.edit.selection import selected_or_refuse

        selected_or_refuse(session.cloud, self.verb)
        placed = world_from_object(context)
        middle = placed @ np.append(median(session.cloud), 1.0)
        pivot = getattr(self, "pivot", "MEDIAN")
        return {"MEDIAN": middle, "CURSOR": np.array(context.scene.cursor.location), "ORIGIN": placed[:, 3]}[pivot]


class STIPPLE_OT_translate(DragOperator, TransformOperator, bpy.types.Operator):
    """Move the selected splats"""

    bl_idname = "stipple.translate"
    bl_label = "Move Splats"
    value: FloatVectorProperty(name="Move", description="Way along each axis of the world", subtype="TRANSLATION")  # type: ignore[valid-type]
    kind: ClassVar[str] = "translate"
    verb = "move"

    def matrix(self, pivot: np.ndarray) -> np.ndarray:
        from ...engine.edit import affine

        return affine.translation(tuple(self.value))


class STIPPLE_OT_rotate(DragOperator, TransformOperator, bpy.types.Operator):
    """Rotate the selected splats, with the colors that depend on the view"""

    bl_idname = "stipple.rotate"
    bl_label = "Rotate Splats"
    value: FloatProperty(name="Angle", description="Angle to turn by", subtype="ANGLE", step=100)  # type: ignore[valid-type]
    axis: FloatVectorProperty(  # type: ignore[valid-type]
        name="Axis", description="Direction to turn about, in the world", default=(0.0, 0.0, 1.0), subtype="XYZ"
    )
    pivot: EnumProperty(name="Pivot", description="Place that stays where it is", items=PIVOTS, default="MEDIAN")  # type: ignore[valid-type]
    kind: ClassVar[str] = "rotate"
    verb = "rotate"

    def matrix(self, pivot: np.ndarray) -> np.ndarray:
        from ...engine.edit import affine

        return affine.rotation(tuple(self.axis), self.value, pivot)


class STIPPLE_OT_resize(DragOperator, TransformOperator, bpy.types.Operator):
    """Scale the selected splats, their sizes and their distances"""

    bl_idname = "stipple.resize"
    bl_label = "Scale Splats"
    value: FloatVectorProperty(  # type: ignore[valid-type]
        name="Scale", description="Factor along each axis of the world", default=(1.0, 1.0, 1.0), subtype="XYZ"
    )
    pivot: EnumProperty(name="Pivot", description="Place that stays where it is", items=PIVOTS, default="MEDIAN")  # type: ignore[valid-type]
    kind: ClassVar[str] = "resize"
    verb = "scale"

    def matrix(self, pivot: np.ndarray) -> np.ndarray:
        from ...engine.edit import affine

        return affine.scaling(tuple(self.value), pivot)


class STIPPLE_OT_mirror(TransformOperator, bpy.types.Operator):
    """Mirror the selected splats along a world axis"""

    bl_idname = "stipple.mirror"
    bl_label = "Mirror Splats"
    verb = "mirror"
    axis: EnumProperty(name="Axis", description="Axis of the world that is turned round", items=AXES, default="X")  # type: ignore[valid-type]
    pivot: EnumProperty(name="Pivot", description="Place that stays where it is", items=PIVOTS, default="MEDIAN")  # type: ignore[valid-type]

    def matrix(self, pivot: np.ndarray) -> np.ndarray:
        from ...engine.edit import affine

        return affine.mirroring(np.eye(3)["XYZ".index(self.axis)], pivot)


class STIPPLE_OT_shear(TransformOperator, bpy.types.Operator):
    """Shear the selected splats: the farther along one axis of the world, the farther they move along another"""

    bl_idname = "stipple.shear"
    bl_label = "Shear Splats"
    verb = "shear"
    angle: FloatProperty(  # type: ignore[valid-type]
        name="Angle",
        description="Angle that what stands upright leans by",
        min=-STEEPEST,
        max=STEEPEST,
        subtype="ANGLE",
        step=100,
    )
    axis: EnumProperty(name="Along", description="Axis that splats move along", items=AXES, default="X")  # type: ignore[valid-type]
    across: EnumProperty(  # type: ignore[valid-type]
        name="Upright", description="Axis that leans: its zero is at the pivot", items=AXES, default="Z"
    )
    pivot: EnumProperty(name="Pivot", description="Place that stays where it is", items=PIVOTS, default="MEDIAN")  # type: ignore[valid-type]

    def matrix(self, pivot: np.ndarray) -> np.ndarray:
        from ...engine.edit import affine

        along, across = (np.eye(3)["XYZ".index(axis)] for axis in (self.axis, self.across))
        return affine.shearing(along, across, math.tan(self.angle), pivot)


class STIPPLE_OT_duplicate(SplatOperator, bpy.types.Operator):
    """Duplicate the selected splats; the copies are selected"""

    bl_idname = "stipple.duplicate"
    bl_label = "Duplicate Splats"

    def step(self, context: Any, session: EditSession) -> Any:
        from ...engine.edit.duplicate import duplicate

        session.check_new_splats(self.bl_label)
        return duplicate(session.cloud)

    def sources(self, session: EditSession) -> np.ndarray:
        return session.cloud.selection().indices().numpy()


class STIPPLE_OT_duplicate_move(bpy.types.Macro):
    """Duplicate the selected splats and move the copies"""

    bl_idname = "stipple.duplicate_move"
    bl_label = "Duplicate and Move Splats"
    bl_options = {"REGISTER", "UNDO"}  # noqa: RUF012 - Blender reads a set here


CLASSES = (
    STIPPLE_OT_translate,
    STIPPLE_OT_rotate,
    STIPPLE_OT_resize,
    STIPPLE_OT_mirror,
    STIPPLE_OT_shear,
    STIPPLE_OT_duplicate,
    STIPPLE_OT_duplicate_move,
)


def register() -> None:
    for cls in CLASSES:
        bpy.utils.register_class(cls)
    STIPPLE_OT_duplicate_move.define(STIPPLE_OT_duplicate.bl_idname.replace("stipple.", "STIPPLE_OT_"))
    STIPPLE_OT_duplicate_move.define("STIPPLE_OT_translate")


def unregister() -> None:
    for cls in reversed(CLASSES):
        bpy.utils.unregister_class(cls)
