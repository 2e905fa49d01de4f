# SPDX-License-Identifier: GPL-3.0-or-later
"""What is painted on a splat, in eight bytes: a colour and how much of the view-dependent colour remains under it.

A painted splat's base colour is the word's. Its harmonics (all that changes with the view: highlights, sheen) are the
unpainted ones under the linear map

    painted = own · h + (value - own) · tint · h[brightest]

of each coefficient's r, g, b: `own` of it keeps its colour, and the rest of `value` keeps only how bright it is, in
the painted colour's hue. `tint` is the painted base colour over its largest channel, and `brightest` the largest
channel of the unpainted base colour, which is the one that HSV's value follows. So a splat painted grey has grey
highlights, and one painted over has none. (Splatshop, doi 10.1111/cgf.70214, changes the base colour alone: its
figure 12 shows what the harmonics then do.)

The word counts from the unpainted capture, not from the last stroke: word 0 means unpainted, and bit for bit so. That
makes "erase to original" exact and twelve bytes enough to undo a splat, harmonics of any degree included.
"""

from __future__ import annotations

import warp as wp

from ..splats import SH_C0

wp.set_module_options({"enable_backward": False})

UNPAINTED = wp.constant(wp.uint64(0))
SH_C0_F = wp.constant(SH_C0)
LOWEST = wp.constant(-1.0)  # base colours of captures leave 0 … 1; 16 bits over -1 … 3 are a sixty-fourth of 1/255
STEPS_PER_UNIT = wp.constant(65535.0 / 4.0)
UNITS_PER_STEP = wp.constant(4.0 / 65535.0)
FRACTION_STEPS = wp.constant(128.0)  # own and value, 0 … 2
FRACTIONS_PER_STEP = wp.constant(1.0 / 128.0)
DC_PER_COLOUR = wp.constant(1.0 / SH_C0)


@wp.struct
class Paint:
    """A word, unpacked."""

    colour: wp.vec3  # sRGB-encoded base colour
    own: wp.float32  # 0 … 2, 1 unpainted
    value: wp.float32


@wp.func
def base_colour(sh_dc: wp.vec3) -> wp.vec3:
    return wp.vec3(0.5, 0.5, 0.5) + SH_C0_F * sh_dc


@wp.func
def unpacked(word: wp.uint64, base_dc: wp.vec3) -> Paint:
    """The paint on a splat; an unpainted one's is its own colour."""
    paint = Paint()
    if word == UNPAINTED:
        paint.colour = base_colour(base_dc)
        paint.own = 1.0
        paint.value = 1.0
        return paint
    mask = wp.uint64(0xFFFF)
    for k in range(3):
        paint.colour[k] = LOWEST + float((word >> wp.uint64(16 * k)) & mask) * UNITS_PER_STEP
    paint.own = float((word >> wp.uint64(48)) & wp.uint64(255)) * FRACTIONS_PER_STEP
    paint.value = float(word >> wp.uint64(56)) * FRACTIONS_PER_STEP
    return paint


@wp.func
def fraction_steps(now: wp.float32, before: wp.float32) -> wp.uint64:
    """Rounded away from what it was, so that the weakest stroke repeated still arrives."""
    steps = wp.floor(now * FRACTION_STEPS + 0.001)
    if now > before:
        steps = wp.ceil(now * FRACTION_STEPS - 0.001)
    return wp.uint64(wp.clamp(steps, 0.0, 255.0))


@wp.func
def packed(paint: Paint, before: Paint) -> wp.uint64:
    """The word of a paint that follows another; never 0."""
    word = (fraction_steps(paint.own, before.own) << wp.uint64(48)) | (
        fraction_steps(paint.value, before.value) << wp.uint64(56)
    )
    for k in range(3):
        steps = wp.clamp(wp.floor((paint.colour[k] - LOWEST) * STEPS_PER_UNIT + 0.5), 0.0, 65535.0)
        word |= wp.uint64(steps) << wp.uint64(16 * k)
    return wp.max(word, wp.uint64(1))


@wp.func
def painted_dc(word: wp.uint64, base_dc: wp.vec3) -> wp.vec3:
    """Coefficient of band 0 as painted; an unpainted splat's own bits."""
    if word == UNPAINTED:
        return base_dc
    return (unpacked(word, base_dc).colour - wp.vec3(0.5, 0.5, 0.5)) * DC_PER_COLOUR


@wp.func
def brightest_channel(c: wp.vec3) -> wp.int32:
    if c[0] >= c[1] and c[0] >= c[2]:
        return 0
    return wp.where(c[1] >= c[2], 1, 2)


@wp.func
def tint_of(c: wp.vec3) -> wp.vec3:
    """A colour over its largest channel; white for black."""
    positive = wp.vec3(wp.max(c[0], 0.0), wp.max(c[1], 0.0), wp.max(c[2], 0.0))
    largest = wp.max(positive)
    if largest < 1.0e-4:
        return wp.vec3(1.0, 1.0, 1.0)
    return positive / largest
