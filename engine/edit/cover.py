# SPDX-License-Identifier: GPL-3.0-or-later
"""How much of a stroke is on each splat: what a dab adds to it, for a block of splats at once.

The body is C++ because it must be, as in `points/splat.py`: Warp compiles a scalar kernel for the CPU, and these plain
loops over 16 lanes become vector instructions (four times faster). A block is 64 splats on a CPU and one on CUDA, so
that neighbouring threads read neighbouring splats there.
"""

from __future__ import annotations

import warp as wp

from .affine import Affine
from .brush import DeviceBrush

wp.set_module_options({"enable_backward": False})

BLOCK_CPU = 64

# What the loops of a block are written in: groups of `Wide::lanes` splats, and single ones at the end of a capture.
LANES_NATIVE = """
#ifdef __CUDA_ARCH__
    struct Wide { enum { lanes = 1 }; };
#else
    struct Wide { enum { lanes = 16 }; };
#endif
    struct Single { enum { lanes = 1 }; };
"""

COVER_NATIVE = f"""
    {LANES_NATIVE}
    const auto& brush = dab.brush;
    const auto& map = dab.unit_from_object;
    const float a = map.linear.data[0][0], b = map.linear.data[0][1], c = map.linear.data[0][2];
    const float d = map.linear.data[1][0], e = map.linear.data[1][1], f = map.linear.data[1][2];
    const float g = map.linear.data[2][0], h = map.linear.data[2][1], k = map.linear.data[2][2];
    const float u = map.translation[0], v = map.translation[1], w = map.translation[2];
    const float c0 = brush.falloff[0], c1 = brush.falloff[1], c2 = brush.falloff[2], c3 = brush.falloff[3];
    const float full = 65535.0f * brush.strength;
    const bool round = brush.falloff_root != 0, adds = brush.build_up != 0;
    const float* at = (const float*)dab.position.data + (size_t)begin * 3;
    const unsigned* flags = (const unsigned*)dab.state.data + begin;
    unsigned short* covered = (unsigned short*)dab.coverage.data + begin;
    unsigned long long changed = 0, met_first = 0;
    auto cover = [&](auto width, int base) {{
        enum {{ lanes = decltype(width)::lanes }};
        float square[lanes];
        int any = 0, inside[lanes], more[lanes], first_time[lanes];
        for (int i = 0; i < lanes; ++i) {{
            float x = at[3 * (base + i)], y = at[3 * (base + i) + 1], z = at[3 * (base + i) + 2];
            float p = a * x + b * y + c * z + u, q = d * x + e * y + f * z + v, r = g * x + h * y + k * z + w;
            square[i] = p * p + q * q + r * r;
            inside[i] = (square[i] <= 1.0f) & ((flags[base + i] & brush.blocked) == 0);
            any |= inside[i];
        }}
        if (!any) return;
        if (brush.limited)
            for (int i = 0; i < lanes; ++i) {{
                int splat = begin + base + i;
                inside[i] &= dab.limit.data[splat >> 5] >> (splat & 31);
            }}
        for (int i = 0; i < lanes; ++i) {{
            float t = 1.0f - sqrtf(inside[i] ? square[i] : 1.0f);
            float share = c0 + t * (c1 + t * (c2 + t * c3));
            share = round ? sqrtf(share > 0.0f ? share : 0.0f) : share;
            unsigned before = covered[base + i], amount = (unsigned)(int)(full * share + 0.5f);
            // What builds up adds at least one step, so that a weak airbrush arrives in the end.
            unsigned sum = before + ((65535u - before) * amount + 65534u) / 65535u;
            unsigned most = before > amount ? before : amount;
            unsigned after = inside[i] ? (adds ? sum : most) : before;
            covered[base + i] = (unsigned short)after;
            more[i] = after != before;
            first_time[i] = (after != before) & (before == 0);
        }}
        for (int i = 0; i < lanes; ++i) {{
            changed |= (unsigned long long)more[i] << (base + i);
            met_first |= (unsigned long long)first_time[i] << (base + i);
        }}
    }};
    int base = 0;
    for (; base + Wide::lanes <= count; base += Wide::lanes) cover(Wide(), base);
    for (; base < count; ++base) cover(Single(), base);
    return wp::vec_t<2, wp::uint64>(changed, met_first);
"""

Bits = wp.types.vector(2, wp.uint64)


@wp.struct
class Dab:
    """A touch of a brush: the unit ball of `unit_from_object`."""

    brush: DeviceBrush
    unit_from_object: Affine
    position: wp.array(dtype=wp.vec3)
    state: wp.array(dtype=wp.uint32)
    limit: wp.array(dtype=wp.uint32)  # the only splats to paint, one bit each, where the brush is limited
    coverage: wp.array(dtype=wp.uint16)  # of the stroke so far, 0 … 65535


@wp.func_native(COVER_NATIVE)
def cover(dab: Dab, begin: wp.int32, count: wp.int32) -> Bits:
    """Add a dab to the coverage of splats begin … begin + count - 1, of which there are at most 64.

    Bit i of the result's first word: splat begin + i has more of it now; of its second: and had none before.
    """
    ...
