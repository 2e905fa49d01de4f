# SPDX-License-Identifier: GPL-3.0-or-later
"""What a brush makes of paint words, for a block of splats at once; C++ for the reason that `cover.py` gives."""

from __future__ import annotations

import warp as wp

from .brush import DARKEN, ERASE, HUE_SATURATION, LIGHTEN
from .cover import LANES_NATIVE, Bits, Dab
from .paint_word import WORD_NATIVE

wp.set_module_options({"enable_backward": False})

# `keep` of the old colour stays and `mixed` of another comes in; own and value go to 0, or to 1 where paint is erased.
PAINT_NATIVE = f"""
    {LANES_NATIVE}
    {WORD_NATIVE}
    const auto& brush = dab.brush;
    const bool erases = brush.mode == {int(ERASE)}, darkens = brush.mode == {int(DARKEN)};
    const bool lightens = brush.mode == {int(LIGHTEN)}, keeps_value = brush.mode == {int(HUE_SATURATION)};
    unsigned long long* words = (unsigned long long*)colours.paint.data + begin;
    unsigned long long* old_words = (unsigned long long*)colours.before.data + begin;
    const unsigned short* covered = (const unsigned short*)dab.coverage.data + begin;
    const float* base_at = (const float*)colours.base_dc.data + (size_t)begin * 3;
    float* at = (float*)colours.sh_dc.data + (size_t)begin * 3;
    auto paint_group = [&](auto width, int base) {{
        enum {{ lanes = decltype(width)::lanes }};
        unsigned long long now[lanes], old[lanes], word[lanes];
        int changed[lanes];
        float amount[lanes], keep[lanes], largest[lanes], own[lanes], value[lanes], bare[3][lanes], colour[3][lanes];
        for (int i = 0; i < lanes; ++i) {{
            changed[i] = (int)(bits[0] >> (base + i)) & 1;
            now[i] = words[base + i];
            unsigned long long held = old_words[base + i];
            old[i] = (int)(bits[1] >> (base + i)) & 1 ? now[i] : held;
            amount[i] = (float)covered[base + i] * (1.0f / 65535.0f);
            keep[i] = lightens ? 1.0f + amount[i] : 1.0f - amount[i];
            own[i] = old[i] ? own_of(old[i]) : 1.0f;
            value[i] = old[i] ? value_of(old[i]) : 1.0f;
        }}
        for (int k = 0; k < 3; ++k)
            for (int i = 0; i < lanes; ++i) {{
                bare[k][i] = base_colour_of(base_at[3 * (base + i) + k]);
                colour[k][i] = old[i] ? colour_of(old[i], k) : bare[k][i];
            }}
        for (int i = 0; i < lanes; ++i) {{
            float rg = colour[0][i] > colour[1][i] ? colour[0][i] : colour[1][i];
            largest[i] = rg > colour[2][i] ? rg : colour[2][i];
            word[i] = 0;
        }}
        for (int k = 0; k < 3; ++k)
            for (int i = 0; i < lanes; ++i) {{
                float mixed = erases ? bare[k][i] : keeps_value ? largest[i] * brush.tint[k] : brush.colour[k];
                float share = darkens || lightens ? 0.0f : amount[i];
                word[i] |= (unsigned long long)colour_steps(keep[i] * colour[k][i] + share * mixed) << (16 * k);
            }}
        for (int i = 0; i < lanes; ++i) {{
            float back = erases ? amount[i] : 0.0f;
            unsigned own_steps = fraction_steps(keep[i] * own[i] + back, own[i]);
            unsigned value_steps = keeps_value ? fraction_steps(value[i], value[i])
                                               : fraction_steps(keep[i] * value[i] + back, value[i]);
            word[i] |= (unsigned long long)own_steps << 48 | (unsigned long long)value_steps << 56;
            word[i] = word[i] ? word[i] : 1;
            word[i] = erases && (old[i] == 0 || amount[i] >= 1.0f) ? 0 : word[i];
            words[base + i] = changed[i] ? word[i] : now[i];
            old_words[base + i] = old[i];
        }}
        for (int k = 0; k < 3; ++k)
            for (int i = 0; i < lanes; ++i) {{
                float bare_dc = base_at[3 * (base + i) + k], dc = at[3 * (base + i) + k];
                float painted = word[i] ? dc_of(word[i], k) : bare_dc;
                at[3 * (base + i) + k] = changed[i] ? painted : dc;
            }}
    }};
    int base = 0;
    for (; base + Wide::lanes <= count; base += Wide::lanes) {{
        unsigned long long here = bits[0] >> base & ((1ull << Wide::lanes) - 1);
        if (here & (here - 1)) {{
            paint_group(Wide(), base);
        }} else if (here) {{  // one splat: a small brush in a capture in no order would fetch its neighbours in vain
            int i = 0;
            while (!(here >> i & 1)) ++i;
            paint_group(Single(), base + i);
        }}
    }}
    for (; base < count; ++base)
        if (bits[0] >> base & 1) paint_group(Single(), base);
"""


@wp.struct
class StrokeColours:
    """What a stroke of colour reads and writes."""

    before: wp.array(dtype=wp.uint64)  # words at the stroke's start, where coverage is not 0
    base_dc: wp.array(dtype=wp.vec3)
    paint: wp.array(dtype=wp.uint64)
    sh_dc: wp.array(dtype=wp.vec3)
    base_rest: wp.array2d(dtype=wp.vec3)
    sh_rest: wp.array2d(dtype=wp.vec3)  # without columns: harmonics follow later


@wp.func_native(PAINT_NATIVE)
def paint_block(dab: Dab, bits: Bits, colours: StrokeColours, begin: wp.int32, count: wp.int32) -> None:
    """Paint what `cover` found in a block as its coverage says: words, and the coefficient of band 0 with them.

    Words from before the stroke are taken up where a splat is met for the first time.
    """
    ...
