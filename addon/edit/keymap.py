# SPDX-License-Identifier: GPL-3.0-or-later
"""Keys of Edit Splats: those of Blender's edit modes, falling through to Object Mode where nothing is edited."""

from __future__ import annotations

from typing import Any

import bpy

from .operator import SplatOperator

# Operator, key, modifiers, properties.
KEYS: tuple[tuple[str, str, tuple[str, ...], dict[str, Any]], ...] = (
    ("stipple.edit_mode_toggle", "E", (), {}),
    ("stipple.select_all", "A", (), {"action": "SELECT"}),
    ("stipple.select_all", "A", ("alt",), {"action": "DESELECT"}),
    ("stipple.select_all", "I", ("ctrl",), {"action": "INVERT"}),
    ("stipple.select_box", "B", (), {}),
    ("stipple.select_circle", "C", (), {}),
    ("stipple.select_linked", "L", (), {"mode": "ADD"}),
    ("stipple.select_linked", "L", ("shift",), {"mode": "SUB"}),
    ("stipple.select_linked", "L", ("ctrl",), {"under_cursor": False, "splat": -1}),
    ("stipple.select_color", "G", ("shift",), {}),
    ("stipple.select_more", "NUMPAD_PLUS", ("ctrl",), {}),
    ("stipple.select_less", "NUMPAD_MINUS", ("ctrl",), {}),
    ("stipple.delete", "X", (), {}),
    ("stipple.delete", "DEL", (), {}),
    ("stipple.hide", "H", (), {"unselected": False}),
    ("stipple.hide", "H", ("shift",), {"unselected": True}),
    ("stipple.reveal", "H", ("alt",), {}),
    ("stipple.translate", "G", (), {}),
    ("stipple.rotate", "R", (), {}),
    ("stipple.resize", "S", (), {}),
    ("stipple.duplicate_move", "D", ("shift",), {}),
    ("stipple.separate", "P", (), {}),
    ("stipple.join", "J", ("ctrl",), {}),
    ("stipple.call_menu", "M", (), {"menu": "VIEW3D_MT_stipple_mirror"}),
    ("stipple.call_menu", "RIGHTMOUSE", (), {"menu": "VIEW3D_MT_stipple_context"}),
    ("stipple.brush_control", "F", (), {"control": "RADIUS"}),
    ("stipple.brush_control", "F", ("shift",), {"control": "STRENGTH"}),
)
_items: list[tuple[Any, Any]] = []


class STIPPLE_OT_call_menu(SplatOperator, bpy.types.Operator):
    """Open a menu of Edit Splats"""

    bl_idname = "stipple.call_menu"
    bl_label = "Splats Menu"
    bl_options = {"INTERNAL"}  # noqa: RUF012 - Blender reads a set here
    menu: bpy.props.StringProperty()  # type: ignore[valid-type]

    def execute(self, context: Any) -> set[str]:
        return bpy.ops.wm.call_menu(name=self.menu)


class STIPPLE_OT_brush_control(SplatOperator, bpy.types.Operator):
    """Change the size or the strength of the brush with the mouse"""

    bl_idname = "stipple.brush_control"
    bl_label = "Brush Size or Strength"
    bl_options = {"INTERNAL"}  # noqa: RUF012 - Blender reads a set here
    control: bpy.props.EnumProperty(  # type: ignore[valid-type]
        items=(("RADIUS", "Radius", ""), ("STRENGTH", "Strength", ""))
    )

    def invoke(self, context: Any, event: Any) -> set[str]:
        path = f"scene.stipple_edit.{self.control.lower()}"
        bpy.ops.wm.radial_control("INVOKE_DEFAULT", data_path_primary=path)
        return {"FINISHED"}


def register() -> None:
    bpy.utils.register_class(STIPPLE_OT_call_menu)
    bpy.utils.register_class(STIPPLE_OT_brush_control)
    b_config = bpy.context.window_manager.keyconfigs.addon
    if b_config is None:  # in the background
        return
    b_keymap = b_config.keymaps.new("Object Mode", space_type="EMPTY")
    for operator, key, modifiers, properties in KEYS:
        b_item = b_keymap.keymap_items.new(operator, key, "PRESS", **dict.fromkeys(modifiers, True))
        for name, value in properties.items():
            setattr(b_item.properties, name, value)
        _items.append((b_keymap, b_item))


def unregister() -> None:
    while _items:
        b_keymap, b_item = _items.pop()
        b_keymap.keymap_items.remove(b_item)
    bpy.utils.unregister_class(STIPPLE_OT_brush_control)
    bpy.utils.unregister_class(STIPPLE_OT_call_menu)
