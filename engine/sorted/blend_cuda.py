# SPDX-License-Identifier: GPL-3.0-or-later
"""Blend tile fragments front to back on CUDA: a tile is a block, a pixel a thread (Splatshop §3.2.1).

256 threads load 256 fragments into shared memory, then each blends all of them over its pixel; the block stops when
every pixel has. The arithmetic is that of `blend.py`.
"""

from __future__ import annotations

import warp as wp

from ..device_look import OPAQUE, RIM_SHADE, SHADE_SLOPE, SHADED
from ..film import FilmSums
from .order import Ordered
from .sampling import STOP_TRANSMITTANCE, Sampling

wp.set_module_options({"enable_backward": False})

BLEND_PIXEL_NATIVE = f"""
#ifdef __CUDA_ARCH__
    __shared__ float4 shared_place[256], shared_shape[256], shared_colour[256];
    const int lane = threadIdx.x;
    const int pixel_x = x0 + (lane & 15), pixel_y = y0 + (lane >> 4);
    const bool inside = pixel_x < sampling.width && pixel_y < sampling.height;
    const float x = sampling.corner[0] + (float)pixel_x + sampling.offset_px[0];
    const float y = sampling.corner[1] + (float)pixel_y + sampling.offset_px[1];
    float through = 1.0f, red = 0.0f, green = 0.0f, blue = 0.0f, depth = 0.0f;
    bool done = !inside;
    long long blends = 0;
    const float4* place_of = (const float4*)ordered.place.data;
    const float4* shape_of = (const float4*)ordered.shape.data;
    const float4* colour_of = (const float4*)ordered.colour.data;
    for (int base = begin; base < end; base += 256) {{
        // Also keeps the last round's readers ahead of this round's writers.
        if (__syncthreads_count(done) == 256) break;
        if (base + lane < end) {{
            const int j = order_from_fragment.data[base + lane];
            shared_place[lane] = place_of[j];
            shared_shape[lane] = shape_of[j];
            shared_colour[lane] = colour_of[j];
        }}
        __syncthreads();
        const int loaded = min(256, end - base);
        for (int k = 0; k < loaded && !done; ++k) {{
            const float4 place = shared_place[k], shape = shared_shape[k];
            const float dx = x - place.x, dy = y - place.y;
            if (fabsf(dy) > shape.w) continue;
            ++blends;
            const float o0 = shape.x * dx, o1 = shape.y * dx + shape.z * dy;
            const float power = -0.5f * (o0 * o0 + o1 * o1);
            if (power < place.w) continue;
            const float alpha = fminf(place.z * expf(power), place.z < {OPAQUE}f ? sampling.alpha_max : 1.0f);
            float weight = through * alpha;
            through -= weight;
            const float4 colour = shared_colour[k];
            depth += weight * colour.w;
            if (place.z >= {SHADED}f) weight *= fmaxf(1.0f + {2 * SHADE_SLOPE}f * power, {RIM_SHADE}f);
            red += weight * colour.x; green += weight * colour.y; blue += weight * colour.z;
            done = through < {STOP_TRANSMITTANCE}f;
        }}
    }}
    if (inside) {{
        const int pixel = pixel_y * sampling.width + pixel_x;
        wp::vec4d& sum = film.colour.data[pixel];
        sum[0] += red; sum[1] += green; sum[2] += blue; sum[3] += 1.0f - through;
        film.depth.data[pixel] += depth;
    }}
    return blends;
#else
    return 0;
#endif
"""


@wp.func_native(BLEND_PIXEL_NATIVE)
def blend_pixel(
    ordered: Ordered,
    order_from_fragment: wp.array(dtype=wp.int32),
    begin: wp.int32,
    end: wp.int32,
    x0: wp.int32,
    y0: wp.int32,
    sampling: Sampling,
    film: FilmSums,
) -> wp.int64:
    """Blend fragments `begin` … `end` - 1 over this thread's pixel of the tile at (x0, y0), and add it to the film.

    All 256 threads of a block must call it with equal arguments. Returns the splats evaluated.
    """
    ...


@wp.kernel
def blend_pixels_kernel(
    first: wp.int32,
    skip: wp.int32,
    ordered: Ordered,
    order_from_fragment: wp.array(dtype=wp.int32),
    tile_begin: wp.array(dtype=wp.int32),
    tile_end: wp.array(dtype=wp.int32),
    sampling: Sampling,
    film: FilmSums,
    blends: wp.array(dtype=wp.int64),
) -> None:
    i = skip + first + wp.tid()
    tile = i / 256
    row = tile / sampling.columns
    x0, y0 = (tile - row * sampling.columns) * 16, row * 16
    begin, end = tile_begin[tile], tile_end[tile]
    blends[i] = blends[i] + blend_pixel(ordered, order_from_fragment, begin, end, x0, y0, sampling, film)
