# SPDX-License-Identifier: GPL-3.0-or-later
"""A finished picture as scene-linear light, on all cores at once: what hosts that show every frame need.

The same map as `colour.scene_linear_from_display`, which is the reference and takes any dtype. This one is for float32
pictures, turns their rows over on the way, and takes 15 ms of a Xeon core at 1080p where that takes 65: one pass over
memory and not a dozen. The body is C++ because Warp compiles scalar kernels for the CPU, and plain loops over 16 lanes
become vectors.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import warp as wp

from .colour import ALPHA_EMPTY, ENCODED_KNEE, working_space_from_rec709
from .device import launch
from .device_cloud import to_device

wp.set_module_options({"enable_backward": False})

FloatArray = npt.NDArray[np.float32]

PIXELS = wp.constant(64)  # per thread; four times the lanes of a vector

# x^2.4 = x² · 2^(0.4 log2 x): 0.4 of the logarithm and not 2.4, or its rounding would show sixfold. The logarithm is
# that of the mantissa between √½ and √2 by atanh to the ninth power, the exponential Taylor's to the seventh.
LIGHT_NATIVE = f"""
#ifdef __CUDA_ARCH__
    constexpr int lanes = 1;
#else
    constexpr int lanes = 16;
#endif
    for (int base = begin; base < end; base += lanes) {{
        const int count = end - base < lanes ? end - base : lanes;
        float value[3][lanes], alpha[lanes];
        for (int i = 0; i < lanes; ++i) {{
            const float* pixel = (const float*)&display.data[base + (i < count ? i : 0)];
            alpha[i] = pixel[3];
            for (int c = 0; c < 3; ++c) value[c][i] = pixel[c];
        }}
        for (int c = 0; c < 3; ++c) {{
            for (int i = 0; i < lanes; ++i) {{
                const float encoded = alpha[i] > {ALPHA_EMPTY}f ? value[c][i] / alpha[i] : 0.0f;
                const float size = encoded < 0.0f ? -encoded : encoded;
                const float x = (size + 0.055f) / 1.055f;
                union {{ float real; int bits; }} mantissa, power;
                mantissa.real = x;
                const int exponent = (mantissa.bits - 0x3f3504f3) >> 23;  // the bits of √½
                mantissa.bits -= exponent << 23;
                const float m = mantissa.real;
                const float t = (m - 1.0f) / (m + 1.0f), q = t * t;
                float p = 0.32059889f;
                p = p * q + 0.41219858f; p = p * q + 0.57707802f; p = p * q + 0.96179669f; p = p * q + 2.88539008f;
                const float z = 0.4f * ((float)exponent + t * p);
                const int n = (int)(z + 128.5f) - 128;
                const float f = z - (float)n;
                float e = 1.5252734e-5f;
                e = e * f + 1.5403530e-4f; e = e * f + 1.3333558e-3f; e = e * f + 9.6181291e-3f;
                e = e * f + 5.5504109e-2f; e = e * f + 2.4022651e-1f; e = e * f + 6.9314718e-1f; e = e * f + 1.0f;
                power.bits = (n + 127) << 23;
                const float curve = size <= {ENCODED_KNEE}f ? size / 12.92f : x * x * (e * power.real);
                value[c][i] = encoded < 0.0f ? -curve : curve;
            }}
        }}
        for (int i = 0; i < count; ++i) {{
            wp::vec3 rgb(value[0][i], value[1][i], value[2][i]);
            if (mixed) rgb = wp::mul(matrix, rgb);
            // Row by row from the other end.
            const int at = base + i, row = at / columns;
            float* pixel = (float*)&light.data[(rows - 1 - row) * columns + at - row * columns];
            for (int c = 0; c < 3; ++c) pixel[c] = rgb[c] * alpha[i];
            pixel[3] = alpha[i];
        }}
    }}
"""


@wp.func_native(LIGHT_NATIVE)
def linearise(
    display: wp.array(dtype=wp.vec4),
    begin: wp.int32,
    end: wp.int32,
    columns: wp.int32,
    rows: wp.int32,
    mixed: wp.int32,
    matrix: wp.mat33,
    light: wp.array(dtype=wp.vec4),
) -> None:
    """Pixels `begin` … `end` - 1."""
    ...


@wp.kernel
def linearise_kernel(
    first: wp.int32,
    display: wp.array(dtype=wp.vec4),
    columns: wp.int32,
    rows: wp.int32,
    mixed: wp.int32,
    matrix: wp.mat33,
    light: wp.array(dtype=wp.vec4),
) -> None:
    begin = (first + wp.tid()) * PIXELS
    end = wp.min(begin + PIXELS, columns * rows)
    linearise(display, begin, end, columns, rows, mixed, matrix, light)


def light_from_display(rgba: FloatArray, working_space: str = "Rec.709") -> FloatArray:
    """(H, W, 4) premultiplied sRGB-encoded, rows from the top, to premultiplied light, rows from the bottom.

    In float32, off by 1e-6 of the value at most. Raises StippleError for an unknown working space.
    """
    matrix = working_space_from_rec709(working_space)
    height, width, _ = rgba.shape
    given, light = np.ascontiguousarray(rgba, np.float32), np.empty((height, width, 4), np.float32)
    cpu = wp.get_device("cpu")
    views = [to_device(array.reshape(-1, 4), wp.vec4, cpu) for array in (given, light)]
    mixed = int(working_space != "Rec.709")
    inputs = [views[0], width, height, mixed, wp.mat33(*matrix.ravel()), views[1]]
    launch(linearise_kernel, -(-height * width // int(PIXELS)), inputs, cpu, smallest_chunk=256)
    return light
