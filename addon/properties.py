# SPDX-License-Identifier: GPL-3.0-or-later
"""Render settings of a scene: `scene.stipple`."""

from __future__ import annotations

from typing import Any

import bpy
from bpy.props import BoolProperty, EnumProperty, FloatProperty, IntProperty, PointerProperty

from . import graphics_context

METHODS = (
    ("POINTS", "Points", "Scatter each splat as random opaque points; the picture gets cleaner with every sample"),
    ("SORTED", "Sorted", "Blend the splats in depth order; free of noise, needs one sample"),
    ("RAYS", "Rays", "Draw the splats with the graphics hardware, exact on every ray; right when the camera is close"),
)
RAY_ORDERS = (
    ("SORTED", "Sorted", "Blend by the depth of each splat's center; free of noise"),
    ("STOCHASTIC", "Stochastic", "Order per pixel; captures that intersect look right, cleaner with every sample"),
)
DEVICES = (
    ("AUTO", "Automatic", "Use an NVIDIA GPU where there is one, otherwise the CPU"),
    ("CPU", "CPU", "Use the processor"),
    ("CUDA", "CUDA", "Use the first NVIDIA GPU"),
)


def _method_changed(_b_settings: Any, _context: Any) -> None:
    graphics_context.follow_the_file()


STORAGE = (
    ("FULL", "Full Precision", "Splats exactly as they are, 60 to 240 bytes each"),
    ("QUANTISED", "Compact", "21 to 105 bytes a splat; the difference cannot be seen (over 70 dB on real captures)"),
)


class StippleSceneSettings(bpy.types.PropertyGroup):
    """What `engine.settings.Settings` needs, as animatable properties."""

    method: EnumProperty(  # type: ignore[valid-type]
        name="Method",
        description="How splats are turned into a picture",
        items=METHODS,
        default="SORTED",  # free of noise and the fastest without a GPU: the right first picture
        update=_method_changed,
    )
    samples: IntProperty(  # type: ignore[valid-type]
        name="Samples",
        description="Number of random point sets averaged for each pixel; more samples take longer and are less noisy",
        default=64,
        min=1,
        soft_max=1024,
        max=1 << 24,
    )
    viewport_samples: IntProperty(  # type: ignore[valid-type]
        name="Viewport Samples",
        description="Number of random point sets averaged in the viewport; it rests when they are done",
        default=16,
        min=1,
        soft_max=256,
        max=1 << 24,
    )
    supersampling: IntProperty(  # type: ignore[valid-type]
        name="Supersampling",
        description="Subpixels along each side of a pixel, averaged; smooths edges and fine detail",
        default=1,
        min=1,
        soft_max=4,
        max=16,
    )
    seed: IntProperty(  # type: ignore[valid-type]
        name="Seed",
        description="Start of the random numbers; equal seeds give equal pictures",
        default=0,
        min=0,
    )
    ray_order: EnumProperty(  # type: ignore[valid-type]
        name="Order", description="What decides which splat is in front", items=RAY_ORDERS, default="SORTED"
    )
    device: EnumProperty(  # type: ignore[valid-type]
        name="Device", description="Hardware that renders", items=DEVICES, default="AUTO"
    )
    sequence_memory: IntProperty(  # type: ignore[valid-type]
        name="Sequence Memory",
        description="Memory for files of sequences that are not shown at the moment, read ahead or kept [MiB]",
        default=2048,
        min=0,
        soft_max=65536,
        max=1 << 24,
    )
    sh_degree: IntProperty(  # type: ignore[valid-type]
        name="SH Degree",
        description="Highest degree of the view-dependent color; 4 uses everything a capture has, 0 no view dependence",
        default=4,
        min=0,
        max=4,
    )
    antialiased: BoolProperty(  # type: ignore[valid-type]
        name="Antialiased",
        description="Lower the opacity of splats smaller than a pixel; turn on for captures that were trained with it",
        default=False,
    )
    dilation_px2: FloatProperty(  # type: ignore[valid-type]
        name="Pixel Filter",
        description="Variance of the blur that splats get on the screen, in square pixels, as in the capture's "
        "training: 0.3 for 3DGS and gsplat, 0.1 for Mip-Splatting; 0 for none",
        default=0.3,
        min=0.0,
        soft_max=1.0,
        max=100.0,
        precision=2,
        step=1,
    )
    storage: EnumProperty(  # type: ignore[valid-type]
        name="Storage",
        description="How the device holds captures that are in this file",
        items=STORAGE,
        default="FULL",
    )
    points_per_thread: IntProperty(  # type: ignore[valid-type]
        name="Points per Thread",
        description="Points drawn together; more than 1 is faster on a GPU and slightly wrong. Use 1 for final renders",
        default=1,
        min=1,
        max=64,
    )
    alpha_max: FloatProperty(  # type: ignore[valid-type]
        name="Opacity Limit",
        description="Largest opacity of a splat in a pixel, as in the capture's training: "
        "0.99 for the original 3DGS trainer, 0.999 for gsplat",
        default=0.99,
        min=0.5,
        max=1.0,
        precision=3,
        step=0.1,
        subtype="FACTOR",
    )
    show_splat_colors: BoolProperty(  # type: ignore[valid-type]
        name="Splat Colors",
        description="Show captures as colored points in Solid and Material Preview shading",
        default=True,
    )
    show_splat_bounds: BoolProperty(  # type: ignore[valid-type]
        name="Splat Bounds",
        description="Show the bounding box of selected captures in Solid and Material Preview shading",
        default=True,
    )


def register() -> None:
    bpy.utils.register_class(StippleSceneSettings)
    bpy.types.Scene.stipple = PointerProperty(type=StippleSceneSettings)


def unregister() -> None:
    del bpy.types.Scene.stipple
    bpy.utils.unregister_class(StippleSceneSettings)
