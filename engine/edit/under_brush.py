# SPDX-License-Identifier: GPL-3.0-or-later
"""Which splats of a block a dab may touch: the test that runs for every splat of a capture, many times a second.

The body is C++ because it must be, as in `points/splat.py`: Warp compiles a scalar kernel for the CPU, and these plain
loops over 16 lanes become vector instructions (four times faster). A block is 64 splats on a CPU and one on CUDA, so
that neighbouring threads read neighbouring splats there.
"""

from __future__ import annotations

import warp as wp

from .affine import Affine

wp.set_module_options({"enable_backward": False})

BLOCK_CPU = 64

UNDER_BRUSH_NATIVE = """
    const float a = map.linear.data[0][0], b = map.linear.data[0][1], c = map.linear.data[0][2];
    const float d = map.linear.data[1][0], e = map.linear.data[1][1], f = map.linear.data[1][2];
    const float g = map.linear.data[2][0], h = map.linear.data[2][1], k = map.linear.data[2][2];
    const float u = map.translation[0], v = map.translation[1], w = map.translation[2];
    const float* at = (const float*)position.data + (size_t)begin * 3;
    const unsigned* flags = (const unsigned*)state.data + begin;
#ifdef __CUDA_ARCH__
    constexpr int lanes = 1;
#else
    constexpr int lanes = 16;
#endif
    unsigned long long found = 0;
    int base = 0;
    for (; base + lanes <= count; base += lanes) {
        int any = 0, inside[lanes];
        for (int i = 0; i < lanes; ++i) {
            float x = at[3 * (base + i)], y = at[3 * (base + i) + 1], z = at[3 * (base + i) + 2];
            float p = a * x + b * y + c * z + u, q = d * x + e * y + f * z + v, r = g * x + h * y + k * z + w;
            inside[i] = (p * p + q * q + r * r <= 1.0001f) & ((flags[base + i] & blocked) == 0);
            any |= inside[i];
        }
        if (any)
            for (int i = 0; i < lanes; ++i) found |= (unsigned long long)inside[i] << (base + i);
    }
    for (; base < count; ++base) found |= 1ull << base;
    return found;
"""


@wp.func_native(UNDER_BRUSH_NATIVE)
def under_brush(
    map: Affine,
    position: wp.array(dtype=wp.vec3),
    state: wp.array(dtype=wp.uint32),
    blocked: wp.uint32,
    begin: wp.int32,
    count: wp.int32,
) -> wp.uint64:
    """Bit i for splat begin + i, of `count` <= 64: set unless it has a blocked flag or surely is outside the unit ball.

    A little generous at the edge, and for the last splats of an uneven block: whoever paints tests those again.
    """
    ...
