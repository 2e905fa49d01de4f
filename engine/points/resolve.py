# SPDX-License-Identifier: GPL-3.0-or-later
"""Look up what each subpixel saw and add the pixel's mean to the film (§3.1: box filter over s × s subpixels).

Subpixels name the staged record that they saw, or, where records were not kept, the splat's number in the scene; its
colour is then found here, for what was seen and nothing else.
"""

from __future__ import annotations

import warp as wp

from ..device import launch
from ..device_cloud import read_rotation, read_splat
from ..device_look import dressed, shade, shaded_from
from ..film import Film, FilmSums
from ..maths.projection import View, project_splat
from ..placements import Placed, instance_of
from ..staging import Staged, colour_of

wp.set_module_options({"enable_backward": False})

BYTES_PER_SUBPIXEL = {"visibility": 8}
NOTHING = wp.constant(wp.uint64(0xFFFFFFFFFFFFFFFF))
IDENTITY_MASK = wp.constant(wp.uint64((1 << 36) - 1))


@wp.struct
class Subpixels:
    """The visibility buffer of a window, rows from the top."""

    words: wp.array(dtype=wp.uint64)
    per_side: wp.int32  # of a pixel
    columns: wp.int32  # of the window [px]


@wp.func
def word_of(subpixels: Subpixels, pixel: wp.int32, sub: wp.int32) -> wp.uint64:
    """The word of subpixel number `sub` of a pixel."""
    s = subpixels.per_side
    y = pixel / subpixels.columns
    x = pixel - y * subpixels.columns
    return subpixels.words[(y * s + sub / s) * (subpixels.columns * s) + x * s + sub % s]


@wp.func
def shade_at(
    view: View, subpixels: Subpixels, pixel: wp.int32, sub: wp.int32, mean: wp.vec2, covariance: wp.vec4
) -> wp.float32:
    """Brightness of a shaded splat at a subpixel's centre. The offset is whitened by the Cholesky factor."""
    s = subpixels.per_side
    y = pixel / subpixels.columns
    x = pixel - y * subpixels.columns
    step = 1.0 / float(s)
    dx = view.window_low[0] + float(x) + (float(sub % s) + 0.5) * step - mean[0]
    dy = view.window_low[1] + float(y) + (float(sub / s) + 0.5) * step - mean[1]
    l00 = wp.sqrt(covariance[0])
    o0 = dx / l00
    o1 = (dy - covariance[1] / l00 * o0) * l00 / wp.sqrt(covariance[3])
    return shade(o0 * o0 + o1 * o1)


@wp.func
def add_pixel(film: FilmSums, pixel: wp.int32, seen: wp.vec4, depth: wp.float32, count: wp.int32) -> None:
    """Add sums over `count` subpixels: colour and how many saw something, depth."""
    weight = 1.0 / float(count)
    film.colour[pixel] += wp.vec4d(seen * weight)
    film.depth[pixel] += wp.float64(depth * weight)


@wp.kernel
def resolve_records_kernel(first: wp.int32, staged: Staged, view: View, subpixels: Subpixels, film: FilmSums) -> None:
    pixel = first + wp.tid()
    count = subpixels.per_side * subpixels.per_side
    seen = wp.vec4(0.0, 0.0, 0.0, 0.0)
    depth = float(0.0)
    for sub in range(count):
        word = word_of(subpixels, pixel, sub)
        if word != NOTHING:
            i = int(word & IDENTITY_MASK)
            rgb = staged.colour[i]
            centre = staged.centre[i]
            if centre[3] >= shaded_from:
                mean = wp.vec2(centre[0], centre[1])
                rgb = shade_at(view, subpixels, pixel, sub, mean, staged.covariance[i]) * rgb
            seen += wp.vec4(rgb[0], rgb[1], rgb[2], 1.0)
            depth += centre[2]
    add_pixel(film, pixel, seen, depth, count)


@wp.kernel
def resolve_splats_kernel(first: wp.int32, placed: Placed, view: View, subpixels: Subpixels, film: FilmSums) -> None:
    pixel = first + wp.tid()
    count = subpixels.per_side * subpixels.per_side
    seen = wp.vec4(0.0, 0.0, 0.0, 0.0)
    depth = float(0.0)
    for sub in range(count):
        word = word_of(subpixels, pixel, sub)
        if word != NOTHING:
            number = wp.int64(word & IDENTITY_MASK)
            instance = instance_of(placed.first_splat, placed.count, number)
            i = int(number - placed.first_splat[instance])
            cloud, pose = placed.cloud[instance], placed.pose[instance]
            position = read_splat(cloud, i).position
            rgb = colour_of(cloud, pose, view, i, position)
            p = pose.linear * position + pose.translation
            if pose.look.shown_opacity >= shaded_from:
                splat = dressed(read_splat(cloud, i), pose.look)
                e = project_splat(view, pose, p, splat.scale, read_rotation(cloud, i), splat.opacity)
                shape = wp.vec4(e.xx, e.xy, e.yy, e.determinant)
                rgb = shade_at(view, subpixels, pixel, sub, e.mean_px, shape) * rgb
            seen += wp.vec4(rgb[0], rgb[1], rgb[2], 1.0)
            depth += p[2]
    add_pixel(film, pixel, seen, depth, count)


def resolve_records(staged: Staged, view: View, subpixels: Subpixels, film: Film) -> None:
    """Add one sample to the film, whose words name staged records."""
    launch(resolve_records_kernel, film.width * film.height, [staged, view, subpixels, film.sums], film.device)
    film.samples += 1


def resolve_splats(placed: Placed, view: View, subpixels: Subpixels, film: Film) -> None:
    """Add one sample to the film, whose words name splats of the scene."""
    launch(resolve_splats_kernel, film.width * film.height, [placed, view, subpixels, film.sums], film.device)
    film.samples += 1
