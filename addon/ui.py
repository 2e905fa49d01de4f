# SPDX-License-Identifier: GPL-3.0-or-later
"""Panels: what applies to the chosen method, and Blender's own panels that make sense for this engine."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import bpy

from . import overlay
from .render_engine import ENGINE_ID

# Blender's panels for other engines' features that carry the BLENDER_RENDER mark all the same.
FOREIGN_PANELS = ("RENDER_PT_freestyle", "RENDER_PT_simplify", "RENDER_PT_gpencil", "RENDER_PT_grease_pencil")
FOREIGN_PREFIXES = ("VIEWLAYER_PT_freestyle", "MATERIAL_PT_freestyle", "EEVEE_MATERIAL_PT", *FOREIGN_PANELS)
WORLD_SURFACE_PANEL = "EEVEE_WORLD_PT_surface"  # the Background node's color and strength


class StipplePanel:
    """Where Stipple's panels are shown."""

    bl_space_type = "PROPERTIES"
    bl_region_type = "WINDOW"
    bl_context = "render"
    COMPAT_ENGINES = frozenset({ENGINE_ID})

    @classmethod
    def poll(cls, context: Any) -> bool:
        return context.engine in cls.COMPAT_ENGINES

    def _column(self) -> Any:
        layout = self.layout  # type: ignore[attr-defined]
        layout.use_property_split = True
        layout.use_property_decorate = True
        return layout.column()


class RENDER_PT_stipple_sampling(StipplePanel, bpy.types.Panel):
    bl_label = "Sampling"

    def draw(self, context: Any) -> None:
        b_stipple = context.scene.stipple
        column = self._column()
        column.prop(b_stipple, "method")
        if b_stipple.method == "RAYS":
            column.prop(b_stipple, "ray_order")
        accumulates = b_stipple.method == "POINTS" or (
            b_stipple.method == "RAYS" and b_stipple.ray_order == "STOCHASTIC"
        )
        if accumulates:
            column.prop(b_stipple, "viewport_samples")
            column.prop(b_stipple, "samples", text="Render Samples")
        column.prop(b_stipple, "supersampling")
        if accumulates:
            column.prop(b_stipple, "seed")


class RENDER_PT_stipple_splats(StipplePanel, bpy.types.Panel):
    bl_label = "Splats"

    def draw(self, context: Any) -> None:
        b_stipple = context.scene.stipple
        column = self._column()
        column.prop(b_stipple, "sh_degree")
        column.prop(b_stipple, "alpha_max")
        column.prop(b_stipple, "dilation_px2")
        column.prop(b_stipple, "antialiased")


class RENDER_PT_stipple_film(StipplePanel, bpy.types.Panel):
    bl_label = "Film"
    bl_options = {"DEFAULT_CLOSED"}  # noqa: RUF012 - Blender reads a set here

    def draw(self, context: Any) -> None:
        self._column().prop(context.scene.render, "film_transparent")


class RENDER_PT_stipple_performance(StipplePanel, bpy.types.Panel):
    bl_label = "Performance"
    bl_options = {"DEFAULT_CLOSED"}  # noqa: RUF012 - Blender reads a set here

    def draw(self, context: Any) -> None:
        b_stipple = context.scene.stipple
        column = self._column()
        column.prop(b_stipple, "device")
        column.prop(b_stipple, "storage")
        if b_stipple.method == "POINTS":
            column.prop(b_stipple, "points_per_thread")
        column.prop(b_stipple, "sequence_memory")


class VIEWLAYER_PT_stipple_passes(StipplePanel, bpy.types.Panel):
    bl_label = "Passes"
    bl_context = "view_layer"

    def draw(self, context: Any) -> None:
        self._column().prop(context.view_layer, "use_pass_z", text="Depth")


class VIEW3D_PT_stipple_overlay(bpy.types.Panel):
    bl_space_type = "VIEW_3D"
    bl_region_type = "HEADER"
    bl_parent_id = "VIEW3D_PT_overlay"
    bl_label = "Gaussian Splats"

    @classmethod
    def poll(cls, context: Any) -> bool:
        return overlay.is_drawn_by_blender(context)

    def draw(self, context: Any) -> None:
        row = self.layout.row()
        row.prop(context.scene.stipple, "show_splat_colors", text="Colors")
        row.prop(context.scene.stipple, "show_splat_bounds", text="Bounds")


CLASSES = (
    RENDER_PT_stipple_sampling,
    RENDER_PT_stipple_splats,
    RENDER_PT_stipple_film,
    RENDER_PT_stipple_performance,
    VIEWLAYER_PT_stipple_passes,
    VIEW3D_PT_stipple_overlay,
)


def standard_panels() -> Iterator[Any]:
    """Blender's panels that Stipple shares: those every simple engine gets, and the world's surface."""
    for panel in bpy.types.Panel.__subclasses__():
        name = panel.__name__
        engines = getattr(panel, "COMPAT_ENGINES", ())
        shared = "BLENDER_RENDER" in engines and not name.startswith(FOREIGN_PREFIXES)
        if (shared or name == WORLD_SURFACE_PANEL) and panel not in CLASSES:
            yield panel


def register() -> None:
    for cls in CLASSES:
        bpy.utils.register_class(cls)
    for panel in standard_panels():
        panel.COMPAT_ENGINES.add(ENGINE_ID)


def unregister() -> None:
    for panel in standard_panels():
        panel.COMPAT_ENGINES.discard(ENGINE_ID)
    for cls in reversed(CLASSES):
        bpy.utils.unregister_class(cls)
