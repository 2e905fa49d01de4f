# SPDX-License-Identifier: GPL-3.0-or-later
"""Blend tile fragments front to back on a CPU: one row of 16 pixels is one vector.

The body is C++ on clang's 16-wide vector types, because Warp compiles a scalar kernel for the CPU and a scalar kernel
blends some 130 M pixel-splats per second and core where this reaches several hundred million (docs/performance.md).

α = min(alpha_max, opacity · exp(power)), skipped below alpha_min; a pixel stops when it lets less than 1e-4 through.
Where we differ from INRIA: the fragment that crosses 1e-4 is still blended (there it is dropped, which can take 1 % of
a pixel's light); the difference to no early stop at all is below 1e-4.
"""

from __future__ import annotations

import warp as wp

from ..device import launch
from ..device_look import OPAQUE, RIM_SHADE, SHADE_SLOPE, SHADED
from ..film import Film, FilmSums
from .blend_cuda import blend_pixels_kernel
from .order import Ordered
from .sampling import STOP_TRANSMITTANCE, Sampling
from .tiles import Tiles

wp.set_module_options({"enable_backward": False})

BLEND_ROW_NATIVE = f"""
#ifndef __CUDA_ARCH__
    typedef float f16 __attribute__((ext_vector_type(16)));
    typedef int i16 __attribute__((ext_vector_type(16)));
    const f16 lane = {{0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15}};
    const f16 x = lane + (sampling.corner[0] + (float)x0) + sampling.offset_px[0];
    const float y = sampling.corner[1] + (float)pixel_y + sampling.offset_px[1];
    f16 through = 1.0f, red = 0.0f, green = 0.0f, blue = 0.0f, depth = 0.0f;
    long long blends = 0;
    const wp::vec4* place_of = (const wp::vec4*)ordered.place.data;
    const wp::vec4* shape_of = (const wp::vec4*)ordered.shape.data;
    const wp::vec4* colour_of = (const wp::vec4*)ordered.colour.data;
    for (int f = begin; f < end; ++f) {{
        const int j = order_from_fragment.data[f];
        const wp::vec4 place = place_of[j], shape = shape_of[j];
        const float dy = y - place[1];
        if (dy > shape[3] || -dy > shape[3]) continue;
        const f16 dx = x - place[0];
        const f16 o0 = shape[0] * dx, o1 = shape[1] * dx + shape[2] * dy;
        const f16 power = -0.5f * (o0 * o0 + o1 * o1);
        const i16 open = through >= {STOP_TRANSMITTANCE}f;
        if (!__builtin_reduce_or(open)) break;
        const i16 inside = (power >= place[3]) & open;
        blends += 16;
        if (!__builtin_reduce_or(inside)) continue;
        // exp by 2^n · 2^f, f in [-1/2, 1/2], to 5e-7; power is never below ln(alpha_min) where it counts.
        f16 t = __builtin_elementwise_max(power, (f16)(-80.0f)) * 1.44269504f;
        const f16 n = __builtin_elementwise_floor(t + 0.5f);
        t -= n;
        f16 e = 1.535336188e-4f * t + 1.339887440e-3f;
        e = e * t + 9.618437357e-3f; e = e * t + 5.550332471e-2f; e = e * t + 2.402264791e-1f;
        e = e * t + 6.931472028e-1f; e = e * t + 1.0f;
        const i16 exponent = (__builtin_convertvector(n, i16) + 127) << 23;
        f16 scale;
        __builtin_memcpy(&scale, &exponent, sizeof(scale));
        const float limit = place[2] < {OPAQUE}f ? sampling.alpha_max : 1.0f;
        f16 alpha = __builtin_elementwise_min(place[2] * (e * scale), (f16)limit);
        alpha = inside ? alpha : (f16)0.0f;
        f16 weight = through * alpha;
        through -= weight;
        const wp::vec4 colour = colour_of[j];
        depth += weight * colour[3];
        if (place[2] >= {SHADED}f)
            weight *= __builtin_elementwise_max(1.0f + {2 * SHADE_SLOPE}f * power, (f16){RIM_SHADE}f);
        red += weight * colour[0];
        green += weight * colour[1];
        blue += weight * colour[2];
    }}
    const int row = pixel_y * sampling.width;
    for (int i = 0; i < 16 && x0 + i < sampling.width; ++i) {{
        wp::vec4d& sum = film.colour.data[row + x0 + i];
        sum[0] += red[i]; sum[1] += green[i]; sum[2] += blue[i]; sum[3] += 1.0f - through[i];
        film.depth.data[row + x0 + i] += depth[i];
    }}
    return blends;
#else
    return 0;
#endif
"""


@wp.func_native(BLEND_ROW_NATIVE)
def blend_row(
    ordered: Ordered,
    order_from_fragment: wp.array(dtype=wp.int32),
    begin: wp.int32,
    end: wp.int32,
    x0: wp.int32,
    pixel_y: wp.int32,
    sampling: Sampling,
    film: FilmSums,
) -> wp.int64:
    """Blend fragments `begin` … `end` - 1 over 16 pixels from (x0, pixel_y) and add them to the film.

    Returns the pixel-splat pairs evaluated: 16 for every splat whose support reaches the row.
    """
    ...


@wp.kernel
def blend_rows_kernel(
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
    # Rows of one tile follow each other, so that its fragments are read from the cache.
    i = skip + first + wp.tid()
    tile = i / 16
    tile_row = tile / sampling.columns
    pixel_y = tile_row * 16 + i - tile * 16
    if pixel_y < sampling.height:
        x0 = (tile - tile_row * sampling.columns) * 16
        begin, end = tile_begin[tile], tile_end[tile]
        blends[i] = blends[i] + blend_row(ordered, order_from_fragment, begin, end, x0, pixel_y, sampling, film)


def blend_tiles(
    ordered: Ordered, tiles: Tiles, first_row: int, last_row: int, sampling: Sampling, film: Film, blends: wp.array
) -> None:
    """Blend rows of tiles `first_row` … `last_row` - 1 into the film and add the pixel-splat pairs to `blends`.

    `blends` has `blend_counter_count` elements.
    """
    kernel, per_tile = (blend_pixels_kernel, 256) if film.device.is_cuda else (blend_rows_kernel, 16)
    skip, count = first_row * tiles.columns * per_tile, (last_row - first_row) * tiles.columns * per_tile
    arrays = [tiles.order_from_fragment, tiles.begin, tiles.end]
    # 64 rows are four tiles: small enough to even out crowded tiles between threads.
    launch(kernel, count, [skip, ordered, *arrays, sampling, film.sums, blends], film.device, smallest_chunk=64)


def blend_counter_count(tiles: Tiles, device: wp.Device) -> int:
    """Counters of blends: one per row of a tile on a CPU, one per pixel on CUDA."""
    return tiles.columns * tiles.rows * (256 if device.is_cuda else 16)
