# SPDX-License-Identifier: GPL-3.0-or-later
"""Settings of Edit Splats and its brushes: `scene.stipple_edit`."""

from __future__ import annotations

import bpy
from bpy.props import BoolProperty, EnumProperty, FloatProperty, FloatVectorProperty, IntProperty, PointerProperty

BRUSH_MODES = (
    ("RGB", "Color", "Paint the color"),
    ("HUE_SATURATION", "Hue/Saturation", "Paint the hue and saturation and keep the brightness"),
    ("DARKEN", "Darken", "Make darker"),
    ("LIGHTEN", "Lighten", "Make lighter"),
    ("ERASE", "Erase Paint", "Bring the color back that the capture had before it was painted in this session"),
    ("OPACITY", "Opacity", "Paint the opacity"),
    ("ERASE_OPACITY", "Erase Opacity", "Bring back the opacity from before it was painted in this session"),
)
FALLOFFS = tuple((name.upper(), name.title(), "") for name in ("smooth", "sphere", "linear", "sharp", "constant"))


class StippleEditSettings(bpy.types.PropertyGroup):
    """What tools and panels of Edit Splats keep."""

    show_highlight: BoolProperty(  # type: ignore[valid-type]
        name="Highlight Selected", description="Tint selected splats in the viewport", default=True
    )
    radius: IntProperty(  # type: ignore[valid-type]
        name="Radius", description="Size of the brush in pixels", default=50, min=1, soft_max=500, subtype="PIXEL"
    )
    strength: FloatProperty(  # type: ignore[valid-type]
        name="Strength",
        description="How much the middle of the brush does",
        default=1.0,
        min=0,
        max=1,
        subtype="FACTOR",
    )
    color: FloatVectorProperty(  # type: ignore[valid-type]
        name="Color", description="Color to paint", size=3, subtype="COLOR_GAMMA", default=(0.8, 0.2, 0.1), min=0, max=1
    )
    opacity: FloatProperty(  # type: ignore[valid-type]
        name="Opacity", description="Opacity to paint", default=0.5, min=0, max=1, subtype="FACTOR"
    )
    brush_mode: EnumProperty(  # type: ignore[valid-type]
        name="Blend", description="What the brush does", items=BRUSH_MODES, default="RGB"
    )
    falloff: EnumProperty(  # type: ignore[valid-type]
        name="Falloff", description="How the brush fades towards its edge", items=FALLOFFS, default="SMOOTH"
    )
    build_up: BoolProperty(  # type: ignore[valid-type]
        name="Accumulate", description="Let dabs of one stroke add up, as an airbrush does"
    )
    clone_source: FloatVectorProperty(  # type: ignore[valid-type]
        name="Clone Source", description="Place that Clone copies from", subtype="XYZ_LENGTH"
    )
    has_clone_source: BoolProperty(name="Has Clone Source")  # type: ignore[valid-type]
    selected_only: BoolProperty(  # type: ignore[valid-type]
        name="Selected Only", description="Paint only selected splats"
    )


def register() -> None:
    bpy.utils.register_class(StippleEditSettings)
    bpy.types.Scene.stipple_edit = PointerProperty(type=StippleEditSettings)


def unregister() -> None:
    del bpy.types.Scene.stipple_edit
    bpy.utils.unregister_class(StippleEditSettings)
