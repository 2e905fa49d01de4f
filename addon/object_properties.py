# SPDX-License-Identifier: GPL-3.0-or-later
"""Settings of one capture: `object.stipple`. They change how it is shown and none of its splats."""

from __future__ import annotations

from itertools import count
from typing import Any

import bpy
from bpy.props import (
    BoolProperty,
    CollectionProperty,
    EnumProperty,
    FloatProperty,
    FloatVectorProperty,
    IntProperty,
    PointerProperty,
)

from ..engine.look import Look

SHAPES = (
    ("BOX", "Box", "The cube of an empty, or the bounding box of any other object", "MESH_CUBE", 0),
    (
        "SPHERE",
        "Sphere",
        "The sphere of an empty, or the ellipsoid in any other object's bounding box",
        "SPHERE",
        1,
    ),
)
KEEPS = (
    ("INSIDE", "Inside", "Show what lies inside this crop, or inside another one that keeps the inside"),
    ("OUTSIDE", "Outside", "Hide what lies inside"),
)
ANTIALIASING = (
    ("SCENE", "Scene", "As the render settings say"),
    ("ON", "On", "Lower the opacity of splats smaller than a pixel; for captures that were trained with it"),
    ("OFF", "Off", "Keep the opacity of splats smaller than a pixel"),
)
DISPLAYS = (
    ("SPLATS", "Splats", "As trained"),
    ("POINTS", "Points", "An opaque disc for each splat, all of one size on the screen"),
    ("ELLIPSOIDS", "Ellipsoids", "Each splat as a solid body, to see its shape"),
)
DEFAULTS = Look()

changed_looks: dict[int, int] = {}
"""By session_uid of objects and their data: when a setting of theirs was changed last, in numbers that only rise.

Blender then says that the geometry is new, too, and does so for every property of an add-on. It is not.
"""
_numbers = count(1)


def _changed(b_group: Any, _context: Any) -> None:
    b_object = b_group.id_data
    for b_id in (b_object, b_object.data):
        if b_id is not None:
            changed_looks[b_id.session_uid] = next(_numbers)
    b_object.update_tag(refresh={"OBJECT"})


def _options(**values: Any) -> dict[str, Any]:
    return {"override": {"LIBRARY_OVERRIDABLE"}, "update": _changed, **values}


def _is_other_object(b_crop: Any, b_object: Any) -> bool:
    return b_object is not b_crop.id_data


class StippleCrop(bpy.types.PropertyGroup):
    """A volume of another object that keeps or hides splats."""

    use: BoolProperty(**_options(name="Use", description="Crop by this object", default=True))  # type: ignore[valid-type]
    object: PointerProperty(  # type: ignore[valid-type]
        **_options(
            type=bpy.types.Object,
            name="Object",
            description="Object whose box or sphere crops; it can be moved and animated",
            poll=_is_other_object,
        )
    )
    shape: EnumProperty(  # type: ignore[valid-type]
        **_options(name="Shape", description="Volume that crops", items=SHAPES, default="BOX")
    )
    keep: EnumProperty(  # type: ignore[valid-type]
        **_options(name="Keep", description="Side of the volume that is shown", items=KEEPS, default="INSIDE")
    )


class StippleObjectSettings(bpy.types.PropertyGroup):
    """What `engine.look.Look` needs, as animatable properties."""

    exposure: FloatProperty(  # type: ignore[valid-type]
        **_options(
            name="Exposure",
            description="Brightness in stops; 1 doubles the light",
            default=DEFAULTS.exposure,
            soft_min=-5.0,
            soft_max=5.0,
            min=-32.0,
            max=32.0,
        )
    )
    gain: FloatVectorProperty(  # type: ignore[valid-type]
        **_options(
            name="Gain",
            description="Factor on the light of each channel",
            subtype="COLOR",
            default=DEFAULTS.gain,
            min=0.0,
            soft_max=2.0,
            max=1e6,
        )
    )
    saturation: FloatProperty(  # type: ignore[valid-type]
        **_options(
            name="Saturation",
            description="Strength of the colors; 0 leaves their brightness only",
            default=DEFAULTS.saturation,
            min=0.0,
            soft_max=2.0,
            max=100.0,
        )
    )
    tint: FloatVectorProperty(  # type: ignore[valid-type]
        **_options(
            name="Tint",
            description="Color that the capture takes on, at its own brightness",
            subtype="COLOR",
            default=DEFAULTS.tint,
            min=0.0,
            soft_max=1.0,
            max=1e6,
        )
    )
    tint_factor: FloatProperty(  # type: ignore[valid-type]
        **_options(
            name="Tint Factor",
            description="How much of the color comes from the tint",
            subtype="FACTOR",
            default=DEFAULTS.tint_factor,
            min=0.0,
            max=1.0,
        )
    )
    opacity: FloatProperty(  # type: ignore[valid-type]
        **_options(
            name="Opacity",
            description="Factor on the opacity of every splat; many faint ones in a row still cover what is behind",
            default=DEFAULTS.opacity,
            min=0.0,
            soft_max=1.0,
            max=100.0,
        )
    )
    size: FloatProperty(  # type: ignore[valid-type]
        **_options(
            name="Size",
            description="Factor on the size of every splat",
            default=DEFAULTS.size,
            min=0.0,
            soft_max=2.0,
            max=1e6,
        )
    )
    sh_degree: IntProperty(  # type: ignore[valid-type]
        **_options(
            name="SH Degree",
            description="Highest degree of the view-dependent color, if the render settings allow it; "
            "4 uses everything a capture has, 0 no view dependence",
            default=4,
            min=0,
            max=4,
        )
    )
    antialiased: EnumProperty(  # type: ignore[valid-type]
        **_options(
            name="Antialiased",
            description="Whether splats smaller than a pixel lose opacity",
            items=ANTIALIASING,
            default="SCENE",
        )
    )
    display: EnumProperty(  # type: ignore[valid-type]
        **_options(name="Display As", description="What is shown of each splat", items=DISPLAYS, default="SPLATS")
    )
    point_size: FloatProperty(  # type: ignore[valid-type]
        **_options(
            name="Point Size",
            description="Diameter of the discs, in pixels of the picture",
            subtype="PIXEL",
            default=DEFAULTS.point_px,
            min=0.1,
            soft_min=1.0,
            soft_max=20.0,
            max=1e4,
        )
    )
    least_opacity: FloatProperty(  # type: ignore[valid-type]
        **_options(
            name="Least Opacity",
            description="Splats with less opacity are not displayed",
            subtype="FACTOR",
            default=DEFAULTS.least_opacity,
            min=0.0,
            max=1.0,
        )
    )
    crops: CollectionProperty(  # type: ignore[valid-type]
        type=StippleCrop,
        name="Crops",
        description="Volumes that crop, eight at most",
        override={"LIBRARY_OVERRIDABLE", "USE_INSERTION"},
    )
    active_crop: IntProperty(  # type: ignore[valid-type]
        name="Active Crop", description="Row of the list that the panel shows", min=0, override={"LIBRARY_OVERRIDABLE"}
    )


CLASSES = (StippleCrop, StippleObjectSettings)


def register() -> None:
    for cls in CLASSES:
        bpy.utils.register_class(cls)
    bpy.types.Object.stipple = PointerProperty(type=StippleObjectSettings, override={"LIBRARY_OVERRIDABLE"})


def unregister() -> None:
    changed_looks.clear()
    del bpy.types.Object.stipple
    for cls in reversed(CLASSES):
        bpy.utils.unregister_class(cls)
