# SPDX-License-Identifier: GPL-3.0-or-later
"""Throw the points and keep the nearest: sampling (§3.4, appendices A and B) and splatting (§3.1).

The framebuffer is a visibility buffer, one 64-bit word per subpixel: 28 bits of depth above 36 bits of identity, taken
down by atomic minimum. The identity is the number of the staged record where records are kept until the sample is
resolved, else the splat's number in the scene; both count in the same order, so that equal depths are won by the same
splat, as in *sorted*.

The body is C++ because it must be: Warp compiles a scalar kernel for the CPU, and these plain loops over 16 lanes
become vector instructions (4× the points per second of the same arithmetic in a Warp kernel, one Xeon core).
CUDA compiles the same text with one lane.
"""

from __future__ import annotations

import warp as wp

from ..depth_pyramid import IDENTITY_BITS
from ..device import launch
from ..device_look import opaque_from
from ..maths.dilogarithm import LI2_INVERSE_NATIVE, li2
from ..maths.projection import View, depth_key
from ..maths.random import PCG3D_NATIVE
from ..staging import Staged
from .distribute import Work, first_batch
from .rates import FILLED, support_box

wp.set_module_options({"enable_backward": False})

BATCH_CPU = 16  # points per batch; the lanes of one AVX-512 or two AVX2 registers


@wp.struct
class Batch:
    """Consecutive points of one splat, and where they may fall."""

    splat: wp.uint32  # random keys
    stream: wp.uint32
    first_point: wp.int32
    point_count: wp.int32
    mean: wp.vec2  # [subpixels]
    cholesky: wp.vec3  # L00, L10, L11 [subpixels]
    opacity: wp.float32
    li2_opacity: wp.float32
    filled: wp.int32
    box: wp.vec4i  # x0, y0, width, height of the support in the window [subpixels of the frame]
    window: wp.vec4i  # x0, y0, width, height [subpixels of the frame]
    frame_width: wp.int32  # [subpixels]
    alpha_min: wp.float32
    alpha_max: wp.float32
    word: wp.uint64  # what a point writes


# Each lane finds the logarithm of its opacity and its place `at[i]` (-1: outside). A thrown point lies at radius r of
# the corrected density (appendix B), where the opacity is opacity · exp(-r²/2), the very number whose logarithm the
# inverse dilogarithm returns. A filled subpixel takes the opacity at its centre. Then the point is kept or rejected:
# - opacity below alpha_min: 3DGS skips it;
# - thrown, opacity above alpha_max: points are as dense as -ln(1 - opacity), wanted is -ln(1 - alpha_max);
# - filled: a coin with the clamped opacity.
SPLAT_NATIVE = f"""
    {PCG3D_NATIVE}
    {LI2_INVERSE_NATIVE}
#ifdef __CUDA_ARCH__
    constexpr int lanes = 1;
#else
    constexpr int lanes = 16;
#endif
    // sin 2πx for |x| <= 1/4, to 2e-7.
    auto sin_turn = [](float x) {{
        float t = x * 6.2831853f, q = t * t;
        float p = -2.3889859e-8f;
        p = p * q + 2.7525562e-6f; p = p * q - 1.9840874e-4f; p = p * q + 8.3333310e-3f; p = p * q - 1.6666667e-1f;
        return t + t * q * p;
    }};
    const float log_opacity = logf(batch.opacity), log_alpha_min = logf(batch.alpha_min);
    const float log_alpha_max = logf(batch.alpha_max);
    const float low_x = (float)batch.window[0], high_x = (float)(batch.window[0] + batch.window[2]);
    const float low_y = (float)batch.window[1], high_y = (float)(batch.window[1] + batch.window[3]);
    for (int base = 0; base < batch.point_count; base += lanes) {{
        float log_alphas[lanes], coin[lanes];
        int at[lanes];
        if (batch.filled) {{
            float inverse_00 = 1.0f / batch.cholesky[0], inverse_11 = 1.0f / batch.cholesky[2];
            for (int i = 0; i < lanes; ++i) {{
                int point = batch.first_point + base + i;
                int row = point / batch.box[2], column = point - row * batch.box[2];
                int x = batch.box[0] + column, y = batch.box[1] + row;
                unsigned a = batch.splat, b = batch.stream, c = (unsigned)(y * batch.frame_width + x);
                pcg3d(a, b, c);
                float o0 = ((float)x + 0.5f - batch.mean[0]) * inverse_00;
                float o1 = ((float)y + 0.5f - batch.mean[1] - batch.cholesky[1] * o0) * inverse_11;
                log_alphas[i] = log_opacity - 0.5f * (o0 * o0 + o1 * o1);
                coin[i] = (float)(a >> 8) * 5.9604645e-8f;
                at[i] = (y - batch.window[1]) * batch.window[2] + x - batch.window[0];
            }}
        }} else {{
            for (int i = 0; i < lanes; ++i) {{
                unsigned a = batch.splat, b = batch.stream, c = (unsigned)(batch.first_point + base + i);
                pcg3d(a, b, c);
                float u0 = (float)(a >> 8) * 5.9604645e-8f, u1 = (float)(b >> 8) * 5.9604645e-8f;
                float log_alpha = log_li2_inverse((1.0f - u0) * batch.li2_opacity);
                log_alphas[i] = log_alpha;
                coin[i] = (float)(c >> 8) * 5.9604645e-8f;
                float square = 2.0f * (log_opacity - log_alpha);
                square = square > 0.0f ? square : 0.0f;
                float r = sqrtf(square);
                // u1 is the angle in turns, folded to where the polynomial holds.
                float v = u1 - 0.5f, m = v < 0.0f ? -v : v;
                float fold = m - 0.25f;
                float quarter = 0.25f - (fold < 0.0f ? -fold : fold);
                float o0 = r * sin_turn(fold), o1 = r * sin_turn(v < 0.0f ? -quarter : quarter);
                float x = batch.mean[0] + batch.cholesky[0] * o0;
                float y = batch.mean[1] + batch.cholesky[1] * o0 + batch.cholesky[2] * o1;
                bool inside = x >= low_x && y >= low_y && x < high_x && y < high_y;
                at[i] = inside ? ((int)y - batch.window[1]) * batch.window[2] + (int)x - batch.window[0] : -1;
            }}
        }}
        for (int i = 0; i < lanes; ++i) {{
            if (base + i >= batch.point_count || at[i] < 0 || log_alphas[i] < log_alpha_min) continue;
            if (batch.filled) {{
                float alpha = expf(log_alphas[i]);
                if (coin[i] >= (alpha < batch.alpha_max ? alpha : batch.alpha_max)) continue;
            }} else if (log_alphas[i] > log_alpha_max) {{
                float alpha = expf(log_alphas[i]);
                float density = alpha < 1.0f ? -logf(1.0f - alpha) : 1e30f;
                if (coin[i] * density > -logf(1.0f - batch.alpha_max)) continue;
            }}
            unsigned long long* word = (unsigned long long*)&frame.data[at[i]];
#ifdef __CUDA_ARCH__
            if (*word > batch.word) atomicMin(word, (unsigned long long)batch.word);
#else
            unsigned long long seen = __atomic_load_n(word, __ATOMIC_RELAXED);
            while (seen > batch.word &&
                   !__atomic_compare_exchange_n(word, &seen, batch.word, true, __ATOMIC_RELAXED, __ATOMIC_RELAXED)) {{}}
#endif
        }}
    }}
"""


@wp.func_native(SPLAT_NATIVE)
def splat_batch(batch: Batch, frame: wp.array(dtype=wp.uint64)) -> None:
    """Throw one batch of points into the framebuffer."""
    ...


@wp.kernel
def splat_points_kernel(
    first: wp.int32,
    staged: Staged,
    view: View,
    work: Work,
    rates: wp.array(dtype=wp.float32),
    stream: wp.array(dtype=wp.uint32),
    first_splat: wp.array(dtype=wp.int64),
    subpixels: wp.int32,
    batch_size: wp.int32,
    frame: wp.array(dtype=wp.uint64),
) -> None:
    j = first + wp.tid()
    i = work.staged_from_run[work.first_run[0] + work.run_from_batch[j] - 1]
    centre = staged.centre[i]
    covariance = staged.covariance[i]
    s = float(subpixels)
    batch = Batch()
    batch.splat = wp.uint32(staged.splat[i])
    batch.stream = stream[staged.instance[i]]
    batch.first_point = int(work.begin + wp.int64(j) - first_batch(work, i)) * batch_size
    batch.point_count = wp.min(batch_size, work.counts[i] - batch.first_point)
    batch.mean = s * wp.vec2(centre[0], centre[1])
    # Cholesky factor of the covariance; its last entry from the determinant, which has all its digits.
    l00 = wp.sqrt(covariance[0])
    batch.cholesky = s * wp.vec3(l00, covariance[1] / l00, wp.sqrt(covariance[3]) / l00)
    is_opaque = centre[3] >= opaque_from
    batch.opacity = wp.where(is_opaque, centre[3], wp.min(centre[3], 1.0))
    batch.li2_opacity = li2(wp.min(centre[3], 1.0))
    batch.filled = wp.where(rates[i] == FILLED, 1, 0)
    batch.box = support_box(view, covariance, centre, view.window_low, view.window_high, subpixels)
    low = wp.vec2i(view.window_low)
    size = wp.vec2i(view.window_high) - low
    batch.window = subpixels * wp.vec4i(low[0], low[1], size[0], size[1])
    batch.frame_width = int(view.frame_px[0]) * subpixels
    batch.alpha_min = view.alpha_min
    batch.alpha_max = wp.where(is_opaque, 1.0, view.alpha_max)
    identity = wp.uint64(i)
    if first_splat.shape[0] > 0:
        identity = wp.uint64(first_splat[staged.instance[i]] + wp.int64(staged.splat[i]))
    batch.word = (wp.uint64(depth_key(centre[2], view)) << IDENTITY_BITS) | identity
    splat_batch(batch, frame)


def splat_points(
    staged: Staged,
    view: View,
    work: Work,
    rates: wp.array,
    stream: wp.array,
    first_splat: wp.array | None,
    subpixels: int,
    batch_size: int,
    frame: wp.array,
    device: wp.Device,
) -> None:
    """Throw all batches of a pass. `frame` holds one word per subpixel of the window, rows from the top.

    `first_splat` is what to add to a splat's index for its number in the scene, per instance; None writes records.
    """
    inputs = [staged, view, work, rates, stream, first_splat, subpixels, batch_size, frame]
    launch(splat_points_kernel, work.run_from_batch.size, inputs, device)
