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
DARKEST = 1.0e-4  # a colour whose hue counts
DARKEST_F = wp.constant(DARKEST)
LOWEST, UNITS = -1.0, 4.0  # base colours of captures leave 0 … 1; 16 bits over -1 … 3 are a sixty-fourth of 1/255

# How a word is read and written: by single splats here, by lanes of them in `paint_lanes.py`. Bits 0 … 47 are the
# colour, then 8 bits each for own and value, 0 … 2. `dc_of` is one fused operation, which every compiler rounds alike:
# a splat has the same bits whichever kernel writes it.
WORD_NATIVE = f"""
    auto steps_of = [](unsigned long long word, int k) {{ return (float)(int)((word >> (16 * k)) & 0xFFFFu); }};
    auto colour_of = [&](unsigned long long word, int k) {{
        return {LOWEST}f + steps_of(word, k) * {UNITS / 65535.0!r}f;
    }};
    auto own_of = [](unsigned long long word) {{ return (float)(int)((word >> 48) & 255u) * (1.0f / 128.0f); }};
    auto value_of = [](unsigned long long word) {{ return (float)(int)(word >> 56) * (1.0f / 128.0f); }};
    auto dc_of = [&](unsigned long long word, int k) {{
        return fmaf(steps_of(word, k), {UNITS / 65535.0 / SH_C0!r}f, {(LOWEST - 0.5) / SH_C0!r}f);
    }};
    auto base_colour_of = [](float dc) {{ return 0.5f + {SH_C0!r}f * dc; }};
    auto colour_steps = [](float colour) {{
        float steps = (colour - {LOWEST}f) * {65535.0 / UNITS!r}f + 0.5f;
        steps = steps > 0.0f ? steps : 0.0f;
        return (unsigned)(int)(steps < 65535.0f ? steps : 65535.0f);
    }};
    // Rounded away from what it was, so that the weakest stroke repeated still arrives.
    auto fraction_steps = [](float now, float before) {{
        float up = now * 128.0f - 0.001f;
        int down = (int)(now * 128.0f + 0.001f), below = (int)up;
        int steps = now > before ? below + (up > (float)below) : down;
        return (unsigned)(steps < 255 ? steps : 255);
    }};
"""


@wp.struct
class Paint:
    """A word, unpacked."""

    colour: wp.vec3  # sRGB-encoded base colour
    own: wp.float32  # 0 … 2, 1 unpainted
    value: wp.float32


@wp.func
def base_colour(sh_dc: wp.vec3) -> wp.vec3:
    return wp.vec3(0.5, 0.5, 0.5) + SH_C0_F * sh_dc


@wp.func_native(f"{WORD_NATIVE} return wp::vec3(colour_of(word, 0), colour_of(word, 1), colour_of(word, 2));")
def word_colour(word: wp.uint64) -> wp.vec3:
    """Base colour in a painted splat's word."""
    ...


@wp.func_native(f"{WORD_NATIVE} return wp::vec2(own_of(word), value_of(word));")
def word_fractions(word: wp.uint64) -> wp.vec2:
    """Own and value in a painted splat's word."""
    ...


@wp.func
def unpacked(word: wp.uint64, base_dc: wp.vec3) -> Paint:
    """The paint on a splat; an unpainted one's is its own colour."""
    paint = Paint()
    if word == UNPAINTED:
        paint.colour = base_colour(base_dc)
        paint.own = 1.0
        paint.value = 1.0
        return paint
    fractions = word_fractions(word)
    paint.colour = word_colour(word)
    paint.own = fractions[0]
    paint.value = fractions[1]
    return paint


@wp.func_native(f"""{WORD_NATIVE}
    return word ? wp::vec3(dc_of(word, 0), dc_of(word, 1), dc_of(word, 2)) : base_dc;
""")
def painted_dc(word: wp.uint64, base_dc: wp.vec3) -> wp.vec3:
    """Coefficient of band 0 as painted; an unpainted splat's own bits."""
    ...


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
    if largest < DARKEST_F:
        return wp.vec3(1.0, 1.0, 1.0)
    return positive / largest
