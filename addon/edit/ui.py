# SPDX-License-Identifier: GPL-3.0-or-later
"""Edit Splats in the 3D viewport's header, menus and sidebar."""

from __future__ import annotations

from typing import Any

import bpy
import numpy as np

from ...engine.edit.state_bits import DELETED, HIDDEN, LOCKED, SELECTED, SEPARATED
from ...engine.errors import StippleError
from ..linked_capture import is_linked
from ..linked_edits import found_edits
from ..splat_data import splat_count_of, states_of
from .mode import STIPPLE_OT_edit_mode_toggle, edited_object

TOGGLE = STIPPLE_OT_edit_mode_toggle


class VIEW3D_MT_stipple_select(bpy.types.Menu):
    bl_label = "Select Splats"

    def draw(self, context: Any) -> None:
        layout = self.layout
        for text, action in (("All", "SELECT"), ("None", "DESELECT"), ("Invert", "INVERT")):
            layout.operator("stipple.select_all", text=text).action = action
        layout.separator()
        for name in ("box", "circle", "lasso"):
            layout.operator(f"stipple.select_{name}", text=f"{name.title()} Select")
        layout.separator()
        layout.operator("stipple.select_more", text="More")
        layout.operator("stipple.select_less", text="Less")
        b_linked = layout.operator("stipple.select_linked", text="Linked")
        b_linked.under_cursor, b_linked.splat = False, -1
        layout.separator()
        layout.operator_context = "EXEC_DEFAULT"
        for name, text in (("color", "Color"), ("opacity", "Opacity"), ("size", "Size"), ("depth", "Depth")):
            layout.operator(f"stipple.select_{name}", text=f"By {text}")
        layout.operator("stipple.select_plane", text="By Plane").point = context.scene.cursor.location
        layout.operator("stipple.select_in_object", text="In Object")


class VIEW3D_MT_stipple_mirror(bpy.types.Menu):
    bl_label = "Mirror"

    def draw(self, context: Any) -> None:
        for axis in "XYZ":
            self.layout.operator("stipple.mirror", text=f"{axis} Global").axis = axis


class VIEW3D_MT_stipple_clean_up(bpy.types.Menu):
    bl_label = "Clean Up"

    def draw(self, context: Any) -> None:
        for name in ("floaters", "oversized", "faint", "outside"):
            self.layout.operator(f"stipple.clean_{name}")
        self.layout.separator()
        self.layout.operator("stipple.delete_invalid")


class VIEW3D_MT_stipple_splats(bpy.types.Menu):
    bl_label = "Splats"

    def draw(self, context: Any) -> None:
        layout = self.layout
        for name, text in (("translate", "Move"), ("rotate", "Rotate"), ("resize", "Scale")):
            layout.operator(f"stipple.{name}", text=text)
        layout.menu("VIEW3D_MT_stipple_mirror")
        layout.operator("stipple.shear", text="Shear")
        layout.separator()
        layout.operator("stipple.duplicate_move", text="Duplicate")
        layout.operator("stipple.separate", text="Separate")
        layout.operator("stipple.join", text="Join")
        layout.separator()
        layout.menu("VIEW3D_MT_stipple_clean_up")
        layout.separator()
        for text, unselected in (("Hide Selected", False), ("Hide Unselected", True)):
            layout.operator("stipple.hide", text=text).unselected = unselected
        layout.operator("stipple.reveal", text="Reveal Hidden")
        layout.operator("stipple.lock", text="Lock Selected")
        layout.operator("stipple.unlock", text="Unlock All")
        layout.separator()
        for text, unselected in (("Delete", False), ("Delete Unselected", True)):
            layout.operator("stipple.delete", text=text).unselected = unselected
        layout.operator("stipple.restore", text="Restore Deleted")


class VIEW3D_MT_stipple_context(bpy.types.Menu):
    bl_label = "Splats"

    def draw(self, context: Any) -> None:
        VIEW3D_MT_stipple_splats.draw(self, context)


class SplatPanel:
    """In the sidebar's tab *Stipple* while a capture is edited."""

    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "Stipple"

    @classmethod
    def poll(cls, context: Any) -> bool:
        return edited_object(context) is not None


class VIEW3D_PT_stipple_edit(bpy.types.Panel):
    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "Stipple"
    bl_label = "Edit Splats"

    @classmethod
    def poll(cls, context: Any) -> bool:
        return TOGGLE.poll(context)

    def draw(self, context: Any) -> None:
        layout, b_object = self.layout, edited_object(context)
        layout.operator(TOGGLE.bl_idname, text="Edit Splats", depress=b_object is not None, icon="POINTCLOUD_DATA")
        if b_object is None:
            return
        column = layout.column(align=True)
        for name, count in counts(b_object.data).items():
            row = column.row()
            row.label(text=name)
            row.label(text=f"{count:,}")
        layout.prop(context.scene.stipple_edit, "show_highlight")


class VIEW3D_PT_stipple_brush(SplatPanel, bpy.types.Panel):
    bl_label = "Brush"

    def draw(self, context: Any) -> None:
        layout = self.layout
        layout.use_property_split = True
        layout.use_property_decorate = False
        for name in ("brush_mode", "color", "opacity", "radius", "strength", "falloff", "build_up", "selected_only"):
            layout.prop(context.scene.stipple_edit, name)


class VIEW3D_PT_stipple_clean_up(SplatPanel, bpy.types.Panel):
    bl_label = "Clean Up"

    def draw(self, context: Any) -> None:
        column = self.layout.column(align=True)
        for name in ("floaters", "oversized", "faint", "outside"):
            column.operator(f"stipple.clean_{name}")


def counts(b_data: Any) -> dict[str, int]:
    """How many splats are what, for the panel."""
    if is_linked(b_data):
        return _without_zeros(_counts_in_file(b_data))
    states = states_of(b_data)
    if states is None:
        return {"Splats": splat_count_of(b_data), "Selected": 0}
    kept = states[(states & DELETED) == 0]
    found = {
        "Splats": len(kept),
        "Selected": int(np.count_nonzero((kept & (SELECTED | HIDDEN | LOCKED)) == SELECTED)),
        "Hidden": int(np.count_nonzero(kept & HIDDEN)),
        "Locked": int(np.count_nonzero(kept & LOCKED)),
        "Deleted": int(np.count_nonzero((states & (DELETED | SEPARATED)) == DELETED)),
    }
    return _without_zeros(found)


def _counts_in_file(b_data: Any) -> dict[str, int]:
    try:
        found = found_edits(b_data, b_data.name)
    except StippleError:  # which the panel of the linked capture tells
        found = None
    count = b_data.stipple_capture.splat_count
    if found is None:
        return {"Splats": count, "Selected": 0}
    counted = found.edits.counts
    flags = {name.title(): counted[name] for name in ("selected", "hidden", "locked", "deleted")}
    flags["Deleted"] -= counted["separated"]  # these cannot be restored
    return {"Splats": count - counted["deleted"], **flags}


def _without_zeros(found: dict[str, int]) -> dict[str, int]:
    return {name: count for name, count in found.items() if count or name in {"Splats", "Selected"}}


def _draw_header(self: Any, context: Any) -> None:
    if not TOGGLE.poll(context):
        return
    editing = edited_object(context) is not None
    row = self.layout.row(align=True)
    row.operator(TOGGLE.bl_idname, text="Edit Splats", depress=editing, icon="POINTCLOUD_DATA")
    if editing:
        row.menu("VIEW3D_MT_stipple_select")
        row.menu("VIEW3D_MT_stipple_splats")


def _draw_object_menu(self: Any, context: Any) -> None:
    if TOGGLE.poll(context):
        self.layout.separator()
        column = self.layout.column()
        column.operator_context = "INVOKE_REGION_WIN"  # both menus end with what executes: nobody could pick points
        column.operator(TOGGLE.bl_idname, text="Edit Splats")
        column.operator("stipple.join")
        column.operator("stipple.align_points")


CLASSES = (
    VIEW3D_MT_stipple_select,
    VIEW3D_MT_stipple_mirror,
    VIEW3D_MT_stipple_clean_up,
    VIEW3D_MT_stipple_splats,
    VIEW3D_MT_stipple_context,
    VIEW3D_PT_stipple_edit,
    VIEW3D_PT_stipple_brush,
    VIEW3D_PT_stipple_clean_up,
)
PLACES = (
    ("VIEW3D_MT_editor_menus", _draw_header),
    ("VIEW3D_MT_object", _draw_object_menu),
    ("VIEW3D_MT_object_context_menu", _draw_object_menu),
)


def register() -> None:
    for cls in CLASSES:
        bpy.utils.register_class(cls)
    for name, draw in PLACES:
        getattr(bpy.types, name).append(draw)


def unregister() -> None:
    for name, draw in PLACES:
        getattr(bpy.types, name).remove(draw)
    for cls in reversed(CLASSES):
        bpy.utils.unregister_class(cls)
