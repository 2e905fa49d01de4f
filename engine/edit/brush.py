# SPDX-License-Identifier: GPL-3.0-or-later
"""A paint brush: what it does to a splat, and how much of it at which distance from its middle."""

from __future__ import annotations

from dataclasses import dataclass

import warp as wp

from ..errors import StippleError
from .paint_word import UNPAINTED, packed, tint_of, unpacked
from .state import NOT_SELECTABLE

wp.set_module_options({"enable_backward": False})

MODES = ("rgb", "hue_saturation", "darken", "lighten", "erase", "opacity", "erase_opacity")
FALLOFFS = ("smooth", "sphere", "linear", "sharp", "constant")

RGB, HUE_SATURATION, DARKEN, LIGHTEN, ERASE, OPACITY, ERASE_OPACITY = (wp.constant(index) for index in range(7))
SMOOTH, SPHERE, LINEAR, SHARP, CONSTANT = (wp.constant(index) for index in range(5))


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
    opacity: wp.float32
    strength: wp.float32
    falloff: wp.int32
    build_up: wp.int32
    blocked: wp.uint32  # flags of splats it does not touch
    limited: wp.int32  # only splats of a mask


@wp.func
def falloff_at(kind: wp.int32, distance: wp.float32) -> wp.float32:
    """1 in the middle, 0 at a distance of 1; Blender's curves."""
    t = 1.0 - distance
    if kind == SMOOTH:
        return t * t * (3.0 - 2.0 * t)
    if kind == SPHERE:
        return wp.sqrt(wp.max(2.0 * t - t * t, 0.0))
    if kind == LINEAR:
        return t
    if kind == SHARP:
        return t * t
    return 1.0


@wp.func
def painted(brush: DeviceBrush, before: wp.uint64, base_dc: wp.vec3, amount: wp.float32) -> wp.uint64:
    """The word of a splat that had `before` when `amount` (0 … 1) of the brush is on it."""
    old = unpacked(before, base_dc)
    p = unpacked(before, base_dc)
    keep = 1.0 - amount
    if brush.mode == RGB:
        p.colour = keep * old.colour + amount * brush.colour
        p.own = keep * old.own
        p.value = keep * old.value
    elif brush.mode == HUE_SATURATION:
        p.colour = keep * old.colour + amount * wp.max(old.colour) * tint_of(brush.colour)
        p.own = keep * old.own
    elif brush.mode == ERASE:
        if before == UNPAINTED or amount >= 1.0:
            return UNPAINTED
        bare = unpacked(UNPAINTED, base_dc)
        p.colour = keep * old.colour + amount * bare.colour
        p.own = keep * old.own + amount
        p.value = keep * old.value + amount
    else:
        factor = wp.where(brush.mode == DARKEN, keep, 1.0 + amount)
        p.colour = factor * old.colour
        p.own = factor * old.own
        p.value = factor * old.value
    return packed(p, old)


def device_brush(brush: Brush, limited: bool) -> DeviceBrush:
    """As kernels take it. `limited`: it paints only splats of a mask."""
    on_device = DeviceBrush()
    on_device.mode, on_device.falloff = MODES.index(brush.mode), FALLOFFS.index(brush.falloff)
    on_device.colour = wp.vec3(*brush.colour)
    on_device.opacity, on_device.strength = brush.opacity, brush.strength
    on_device.build_up, on_device.limited = int(brush.build_up), int(limited)
    on_device.blocked = NOT_SELECTABLE
    return on_device
