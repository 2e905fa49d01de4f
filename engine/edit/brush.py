# SPDX-License-Identifier: GPL-3.0-or-later
"""A paint brush: what it does to a splat, and how much of it at which distance from its middle."""

from __future__ import annotations

from dataclasses import dataclass

import warp as wp

from ..errors import StippleError
from .paint_word import DARKEST
from .state import NOT_SELECTABLE

wp.set_module_options({"enable_backward": False})

MODES = ("rgb", "hue_saturation", "darken", "lighten", "erase", "opacity", "erase_opacity")
# Of a dab, by t = 1 in its middle and 0 at its edge: polynomials c0 + c1 t + c2 t² + c3 t³ (Blender's curves).
FALLOFF_CURVES = {
    "smooth": (0.0, 0.0, 3.0, -2.0),
    "sphere": (0.0, 2.0, -1.0, 0.0),  # and the root of it
    "linear": (0.0, 1.0, 0.0, 0.0),
    "sharp": (0.0, 0.0, 1.0, 0.0),
    "constant": (1.0, 0.0, 0.0, 0.0),
}
FALLOFFS = tuple(FALLOFF_CURVES)

RGB, HUE_SATURATION, DARKEN, LIGHTEN, ERASE, OPACITY, ERASE_OPACITY = range(7)


@dataclass(frozen=True)
class Brush:
    """What a stroke does.

    - `mode`: "rgb" mixes in `colour`; "hue_saturation" gives its hue and saturation and keeps HSV's value, so texture
      and shade stay; "darken" and "lighten" scale the colour down or up to twice; "erase" goes back to the unpainted
      colour; "opacity" mixes in `opacity`; "erase_opacity" goes back to the unpainted opacity.
    - `colour`: sRGB-encoded, 0 … 1. `opacity`: 0 … 1.
    - `strength`: 0 … 1, what the middle of a dab does. `falloff`: one of `FALLOFFS`, from there to the edge.
    - `build_up`: dabs of one stroke add up, as an airbrush's do.

    Raises StippleError for a value outside its range.
    """

    mode: str = "rgb"
    colour: tuple[float, float, float] = (1.0, 1.0, 1.0)
    opacity: float = 1.0
    strength: float = 1.0
    falloff: str = "smooth"
    build_up: bool = False

    def __post_init__(self) -> None:
        for name, choice, known in (("mode", self.mode, MODES), ("falloff", self.falloff, FALLOFFS)):
            if choice not in known:
                raise StippleError(f"brush {name} is {choice!r}; choose one of {', '.join(known)}.")
        values = {"red": self.colour[0], "green": self.colour[1], "blue": self.colour[2]}
        for name, value in (values | {"opacity": self.opacity, "strength": self.strength}).items():
            if not 0.0 <= value <= 1.0:
                raise StippleError(f"brush {name} is {value}; give a value from 0 to 1.")


@wp.struct
class DeviceBrush:
    mode: wp.int32
    colour: wp.vec3
    tint: wp.vec3  # the colour over its largest channel
    opacity: wp.float32
    strength: wp.float32
    falloff: wp.vec4  # coefficients of `FALLOFF_CURVES`
    falloff_root: wp.int32
    build_up: wp.int32
    blocked: wp.uint32  # flags of splats it does not touch
    limited: wp.int32  # only splats of a mask


def device_brush(brush: Brush, limited: bool) -> DeviceBrush:
    """As kernels take it. `limited`: it paints only splats of a mask."""
    on_device = DeviceBrush()
    on_device.mode = MODES.index(brush.mode)
    on_device.falloff, on_device.falloff_root = wp.vec4(*FALLOFF_CURVES[brush.falloff]), int(brush.falloff == "sphere")
    largest = max(brush.colour)
    on_device.colour = wp.vec3(*brush.colour)
    on_device.tint = wp.vec3(*(channel / largest if largest >= DARKEST else 1.0 for channel in brush.colour))
    on_device.opacity, on_device.strength = brush.opacity, brush.strength
    on_device.build_up, on_device.limited = int(brush.build_up), int(limited)
    on_device.blocked = NOT_SELECTABLE
    return on_device
