# SPDX-License-Identifier: GPL-3.0-or-later
"""A finished picture as scene-linear light, on the device: what hosts that show every frame need.

The same map as `colour.scene_linear_from_display`, which is the reference and takes any dtype. This one is for float32
pictures, turns their rows over on the way, and takes 14 ms of a Xeon core at 1080p where that takes 65: one pass over
memory and not a dozen, and in place, for 33 MB that are new each frame take 7 ms to be had. The body is C++ because
Warp compiles scalar kernels for the CPU, and plain loops over 16 lanes become vectors.
"""

from __future__ import annotations

from typing import Any

import warp as wp

from .colour import ALPHA_EMPTY, ENCODED_KNEE, working_space_from_rec709
from .device import launch

wp.set_module_options({"enable_backward": False})

PIXELS = wp.constant(64)  # per thread, and as many in the lower half; four times the lanes of a vector

# x^2.4 = x² · 2^(0.4 log2 x): 0.4 of the logarithm and not 2.4, or its rounding would show sixfold. The logarithm is
# that of the mantissa between √½ and √2 by atanh to the ninth power, the exponential Taylor's to the seventh.
LIGHT_NATIVE = f"""
#ifdef __CUDA_ARCH__
    constexpr int lanes = 1;
#else
    constexpr int lanes = 16;
#endif
    wp::vec4* pixels = picture.data;
    for (int base = begin; base < end; base += lanes) {{
        const int count = end - base < lanes ? end - base : lanes;
        int place[2][lanes];  // of a pixel and of the one in the same column of the row that it changes places with
        for (int i = 0; i < lanes; ++i) {{
            const int at = base + (i < count ? i : 0), row = at / columns;
            place[0][i] = at;
            place[1][i] = (rows - 1 - row) * columns + at - row * columns;
        }}
        float value[2][3][lanes], alpha[2][lanes];
        for (int side = 0; side < 2; ++side) {{
            for (int i = 0; i < lanes; ++i) {{
                const float* pixel = (const float*)&pixels[place[side][i]];
                alpha[side][i] = pixel[3];
                for (int c = 0; c < 3; ++c) value[side][c][i] = pixel[c];
            }}
            for (int c = 0; c < 3; ++c) {{
                for (int i = 0; i < lanes; ++i) {{
                    const float opacity = alpha[side][i];
                    const float encoded = opacity > {ALPHA_EMPTY}f ? value[side][c][i] / opacity : 0.0f;
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
                    value[side][c][i] = encoded < 0.0f ? -curve : curve;
                }}
            }}
        }}
        for (int side = 0; side < 2; ++side) {{
            for (int i = 0; i < count; ++i) {{
                wp::vec3 rgb(value[side][0][i], value[side][1][i], value[side][2][i]);
                if (mixed) rgb = wp::mul(matrix, rgb);
                float* pixel = (float*)&pixels[place[1 - side][i]];
                for (int c = 0; c < 3; ++c) pixel[c] = rgb[c] * alpha[side][i];
                pixel[3] = alpha[side][i];
            }}
        }}
    }}
"""


@wp.func_native(LIGHT_NATIVE)
def linearise(
    picture: wp.array(dtype=wp.vec4),
    begin: wp.int32,
    end: wp.int32,
    columns: wp.int32,
    rows: wp.int32,
    mixed: wp.int32,
    matrix: wp.mat33,
) -> None:
    """Pixels `begin` … `end` - 1 of the upper half, and those that they change places with."""
    ...


@wp.struct
class ToLight:
    """The size of a picture and the working space that its light is for."""

    columns: wp.int32
    rows: wp.int32
    mixed: wp.int32  # 0 where `matrix` is the identity
    matrix: wp.mat33  # working space from Rec.709


@wp.func
def end_of_block(begin: wp.int32, to_light: ToLight) -> wp.int32:
    return wp.min(begin + PIXELS, to_light.columns * ((to_light.rows + 1) / 2))


@wp.kernel
def linearise_kernel(first: wp.int32, picture: wp.array(dtype=wp.vec4), to_light: ToLight) -> None:
    begin = (first + wp.tid()) * PIXELS
    end = end_of_block(begin, to_light)
    linearise(picture, begin, end, to_light.columns, to_light.rows, to_light.mixed, to_light.matrix)


def to_light_of(height: int, width: int, working_space: str) -> ToLight:
    """Raises StippleError for an unknown working space."""
    to_light = ToLight()
    to_light.columns, to_light.rows = width, height
    to_light.mixed = int(working_space != "Rec.709")
    to_light.matrix = wp.mat33(*working_space_from_rec709(working_space).ravel())
    return to_light


def launch_blocks(kernel: wp.Kernel, inputs: list[Any], to_light: ToLight, device: wp.Device) -> None:
    """A kernel that makes light of each block of `PIXELS` in the upper half, and of those they change places with."""
    pixels = to_light.columns * ((to_light.rows + 1) // 2)
    launch(kernel, -(-pixels // int(PIXELS)), [*inputs, to_light], device, smallest_chunk=256)


def light_from_display(rgba: wp.array, working_space: str = "Rec.709") -> None:
    """(H, W) of vec4, premultiplied sRGB-encoded, rows from the top, to premultiplied light, rows from the bottom.

    In place, on the array's device. Off by 1e-6 of the value at most. Raises StippleError for an unknown working space.
    """
    height, width = rgba.shape
    launch_blocks(linearise_kernel, [rgba.flatten()], to_light_of(height, width, working_space), rgba.device)
