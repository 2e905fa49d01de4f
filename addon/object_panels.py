# SPDX-License-Identifier: GPL-3.0-or-later
"""Object properties > Gaussian Splats: the settings of one capture."""

from __future__ import annotations

from typing import Any

import bpy

from .operators.crops import OBJECT_OT_stipple_crop_add, OBJECT_OT_stipple_crop_remove
from .splat_data import POINT_TYPES, is_capture
from .ui import StipplePanel


class ObjectPanel(StipplePanel):
    """Shown for captures, also for those that modifiers make."""

    bl_context = "object"

    @classmethod
    def poll(cls, context: Any) -> bool:
        b_object = context.object
        if not super().poll(context) or b_object is None or b_object.type not in POINT_TYPES:
            return False
        return is_capture(b_object.data) or is_capture(b_object.evaluated_get(context.view_layer.depsgraph).data)


class OBJECT_PT_stipple(ObjectPanel, bpy.types.Panel):
    bl_label = "Gaussian Splats"

    def draw(self, context: Any) -> None:
        """Nothing of its own: the panels inside hold the settings."""


class OBJECT_PT_stipple_color(ObjectPanel, bpy.types.Panel):
    bl_label = "Color"
    bl_parent_id = "OBJECT_PT_stipple"

    def draw(self, context: Any) -> None:
        b_stipple, column = context.object.stipple, self._column()
        column.prop(b_stipple, "exposure")
        column.prop(b_stipple, "gain")
        column.prop(b_stipple, "saturation", slider=True)
        column.prop(b_stipple, "tint")
        column.prop(b_stipple, "tint_factor", text="Factor")


class OBJECT_PT_stipple_splats(ObjectPanel, bpy.types.Panel):
    bl_label = "Splats"
    bl_parent_id = "OBJECT_PT_stipple"

    def draw(self, context: Any) -> None:
        b_stipple, column = context.object.stipple, self._column()
        column.prop(b_stipple, "opacity", slider=True)
        column.prop(b_stipple, "size", slider=True)
        column.prop(b_stipple, "sh_degree")
        column.prop(b_stipple, "antialiased")


class STIPPLE_UL_crops(bpy.types.UIList):
    """A row per crop: the object, its shape, which side is kept, whether it is in use."""

    bl_idname = "STIPPLE_UL_crops"

    def draw_item(
        self, _context: Any, layout: Any, _data: Any, b_crop: Any, _icon: Any, _active: Any, _active_property: Any
    ) -> None:
        row = layout.row(align=True)
        row.active = b_crop.use
        name = b_crop.object.name if b_crop.object else "No Object"
        row.label(text=name, icon="ERROR" if b_crop.object is None else _shape_icon(b_crop))
        row.label(text="", icon="SELECT_INTERSECT" if b_crop.keep == "INSIDE" else "SELECT_SUBTRACT")
        row.prop(b_crop, "use", text="", emboss=False, icon="CHECKBOX_HLT" if b_crop.use else "CHECKBOX_DEHLT")


class OBJECT_PT_stipple_crop(ObjectPanel, bpy.types.Panel):
    bl_label = "Crop"
    bl_parent_id = "OBJECT_PT_stipple"

    def draw(self, context: Any) -> None:
        b_stipple = context.object.stipple
        row = self.layout.row()
        row.template_list("STIPPLE_UL_crops", "", b_stipple, "crops", b_stipple, "active_crop", rows=3)
        buttons = row.column(align=True)
        buttons.operator(OBJECT_OT_stipple_crop_add.bl_idname, text="", icon="ADD")
        buttons.operator(OBJECT_OT_stipple_crop_remove.bl_idname, text="", icon="REMOVE").index = -1
        if b_stipple.active_crop < len(b_stipple.crops):
            b_crop, column = b_stipple.crops[b_stipple.active_crop], self._column()
            column.prop(b_crop, "object")
            column.prop(b_crop, "shape")
            column.prop(b_crop, "keep")


class OBJECT_PT_stipple_display(ObjectPanel, bpy.types.Panel):
    bl_label = "Display"
    bl_parent_id = "OBJECT_PT_stipple"
    bl_options = {"DEFAULT_CLOSED"}  # noqa: RUF012 - Blender reads a set here

    def draw(self, context: Any) -> None:
        b_stipple, column = context.object.stipple, self._column()
        column.prop(b_stipple, "display")
        if b_stipple.display == "POINTS":
            column.prop(b_stipple, "point_size")
        if b_stipple.display != "SPLATS":
            column.prop(b_stipple, "least_opacity")


def _shape_icon(b_crop: Any) -> str:
    return str(b_crop.bl_rna.properties["shape"].enum_items[b_crop.shape].icon)


CLASSES = (
    STIPPLE_UL_crops,
    OBJECT_PT_stipple,
    OBJECT_PT_stipple_color,
    OBJECT_PT_stipple_splats,
    OBJECT_PT_stipple_crop,
    OBJECT_PT_stipple_display,
)


def register() -> None:
    for cls in CLASSES:
        bpy.utils.register_class(cls)


def unregister() -> None:
    for cls in reversed(CLASSES):
        bpy.utils.unregister_class(cls)
