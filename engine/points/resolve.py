# SPDX-License-Identifier: GPL-3.0-or-later
"""Look up what each subpixel saw and add the pixel's mean to the film (§3.1: box filter over s × s subpixels)."""

from __future__ import annotations

import warp as wp

from ..device import launch
from ..film import Film, FilmSums
from ..maths.projection import View
from ..staging import Staged

wp.set_module_options({"enable_backward": False})

BYTES_PER_SUBPIXEL = {"visibility": 8}
NOTHING = wp.constant(wp.uint64(0xFFFFFFFFFFFFFFFF))
IDENTITY_MASK = wp.constant(wp.uint64((1 << 36) - 1))


@wp.kernel
def resolve_points_kernel(
    first: wp.int32, staged: Staged, view: View, subpixels: wp.int32, frame: wp.array(dtype=wp.uint64), film: FilmSums
) -> None:
    pixel = first + wp.tid()
    width = int(view.window_high[0] - view.window_low[0])
    y = pixel / width
    x = pixel - y * width
    rgb = wp.vec3(0.0, 0.0, 0.0)
    depth = float(0.0)
    seen = float(0.0)
    for sub_y in range(subpixels):
        row = (y * subpixels + sub_y) * (width * subpixels) + x * subpixels
        for sub_x in range(subpixels):
            word = frame[row + sub_x]
            if word != NOTHING:
                i = int(word & IDENTITY_MASK)
                rgb += staged.colour[i]
                depth += staged.centre[i][2]
                seen += 1.0
    weight = 1.0 / float(subpixels * subpixels)
    film.colour[pixel] += wp.vec4d(wp.vec4(rgb[0] * weight, rgb[1] * weight, rgb[2] * weight, seen * weight))
    film.depth[pixel] += wp.float64(depth * weight)


def resolve_points(staged: Staged, view: View, subpixels: int, frame: wp.array, film: Film) -> None:
    """Add one sample to the film."""
    inputs = [staged, view, subpixels, frame, film.sums]
    launch(resolve_points_kernel, film.width * film.height, inputs, film.device)
    film.samples += 1
