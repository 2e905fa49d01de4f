# SPDX-License-Identifier: GPL-3.0-or-later
"""Tools of the 3D viewport's toolbar; they do nothing but fall through while no capture is edited."""

from __future__ import annotations

from typing import Any

import bpy

from .mode import edited_object
from .overlay import draw_circle

DRAG = {"type": "LEFTMOUSE", "value": "PRESS"}
DRAWN = {"properties": [("wait_for_input", False)]}


def keys(operator: str, *more: tuple[str, Any]) -> tuple[Any, ...]:
    """The operator on the left button; with Shift it extends and with Ctrl it takes away."""
    return tuple(
        (operator, DRAG | modifier, {"properties": [("wait_for_input", False), ("mode", mode), *more]})
        for modifier, mode in (({}, "SET"), ({"shift": True}, "ADD"), ({"ctrl": True}, "SUB"))
    )


def draw_brush(context: Any, _tool: Any, place: tuple[float, float]) -> None:
    if edited_object(context) is not None:
        draw_circle(place, context.scene.stipple_edit.radius)


class SplatTool(bpy.types.WorkSpaceTool):
    bl_space_type = "VIEW_3D"
    bl_context_mode = "OBJECT"


class SelectBoxTool(SplatTool):
    bl_idname = "stipple.select_box_tool"
    bl_label = "Select Splats: Box"
    bl_description = "Select splats with a rectangle"
    bl_icon = "ops.generic.select_box"
    bl_keymap = keys("stipple.select_box")


class SelectCircleTool(SplatTool):
    bl_idname = "stipple.select_circle_tool"
    bl_label = "Select Splats: Circle"
    bl_description = "Select splats with a round brush"
    bl_icon = "ops.generic.select_circle"
    bl_keymap = keys("stipple.select_circle")
    draw_cursor = staticmethod(draw_brush)

    @staticmethod
    def draw_settings(context: Any, layout: Any, tool: Any) -> None:
        layout.prop(context.scene.stipple_edit, "radius")
        b_properties = tool.operator_properties("stipple.select_circle")
        layout.prop(b_properties, "border")
        layout.prop(b_properties, "visible_only")


class SelectLassoTool(SplatTool):
    bl_idname = "stipple.select_lasso_tool"
    bl_label = "Select Splats: Lasso"
    bl_description = "Select splats inside a line drawn around them"
    bl_icon = "ops.generic.select_lasso"
    bl_keymap = keys("stipple.select_lasso")


class PaintTool(SplatTool):
    bl_idname = "stipple.paint_tool"
    bl_label = "Paint Splats"
    bl_description = "Paint splats, with the colors that depend on the view"
    bl_icon = "brush.paint_vertex.replace"
    bl_keymap = (
        ("stipple.paint", DRAG, None),
        ("stipple.paint", DRAG | {"ctrl": True}, {"properties": [("mode", "ERASE")]}),
    )
    draw_cursor = staticmethod(draw_brush)

    @staticmethod
    def draw_settings(context: Any, layout: Any, tool: Any) -> None:
        b_settings = context.scene.stipple_edit
        layout.prop(b_settings, "brush_mode", text="")
        if b_settings.brush_mode in {"RGB", "HUE_SATURATION"}:
            layout.prop(b_settings, "color", text="")
        elif b_settings.brush_mode == "OPACITY":
            layout.prop(b_settings, "opacity")
        for name in ("radius", "strength", "falloff", "build_up", "selected_only"):
            layout.prop(b_settings, name)


class EraseTool(SplatTool):
    bl_idname = "stipple.erase_tool"
    bl_label = "Erase Paint"
    bl_description = "Bring the color back that splats had before they were painted"
    bl_icon = "ops.gpencil.draw.eraser"
    bl_keymap = (("stipple.paint", DRAG, {"properties": [("mode", "ERASE")]}),)
    draw_cursor = staticmethod(draw_brush)

    @staticmethod
    def draw_settings(context: Any, layout: Any, tool: Any) -> None:
        for name in ("radius", "strength", "falloff"):
            layout.prop(context.scene.stipple_edit, name)


class CloneTool(SplatTool):
    bl_idname = "stipple.clone_tool"
    bl_label = "Clone Splats"
    bl_description = "Copy splats from another place; Ctrl-click where to copy from"
    bl_icon = "brush.paint_texture.clone"
    bl_keymap = (("stipple.clone_source", DRAG | {"ctrl": True}, None), ("stipple.clone", DRAG, None))
    draw_cursor = staticmethod(draw_brush)

    @staticmethod
    def draw_settings(context: Any, layout: Any, tool: Any) -> None:
        layout.prop(context.scene.stipple_edit, "radius")


SELECTING = (SelectBoxTool, SelectCircleTool, SelectLassoTool)
PAINTING = (PaintTool, EraseTool, CloneTool)
_registered: list[type] = []


def register() -> None:
    if bpy.app.background:  # there is no toolbar
        return
    for group in (SELECTING, PAINTING):
        first = group[0]
        bpy.utils.register_tool(first, after={"builtin.measure"}, separator=True, group=True)
        for tool in group[1:]:
            bpy.utils.register_tool(tool, after={first.bl_idname})
        _registered.extend(group)


def unregister() -> None:
    while _registered:
        bpy.utils.unregister_tool(_registered.pop())
