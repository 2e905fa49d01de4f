# SPDX-License-Identifier: GPL-3.0-or-later
"""A depth pyramid: the farthest depth of ever larger squares of pixels (§3.5 of doi 10.1145/3811272).

Level 0 has the pixels of the window, each the farthest of its subpixels; every further level halves both sides, rounded
up. Depths are the 28-bit keys of the visibility buffer, so that comparing them is comparing what decides a subpixel;
a subpixel that nothing was seen in counts as farther than everything.
"""

from __future__ import annotations

import warp as wp

from .buffers import Buffers
from .device import launch

wp.set_module_options({"enable_backward": False})

IDENTITY_BITS = wp.constant(wp.uint64(36))  # of a visibility buffer's word, below the depth key
MOST_LEVELS = 16


@wp.struct
class DepthPyramid:
    """Keys of all levels, one after the other, rows from the top. Without levels it hides nothing."""

    level_count: wp.int32
    size: wp.array(dtype=wp.vec2i)  # columns, rows per level
    begin: wp.array(dtype=wp.int32)  # of each level in `keys`
    keys: wp.array(dtype=wp.uint32)


@wp.func
def is_hidden(pyramid: DepthPyramid, low: wp.vec2, high: wp.vec2, nearest: wp.uint32) -> wp.bool:
    """Whether all that was seen between two corners [px of the window] is nearer than the key `nearest`.

    Looks at the finest level at which the corners lie in the same or in neighbouring squares.
    """
    if pyramid.level_count == 0:
        return False
    limit = pyramid.size[0] - wp.vec2i(1, 1)
    x0 = int(wp.clamp(low[0], 0.0, float(limit[0])))
    y0 = int(wp.clamp(low[1], 0.0, float(limit[1])))
    x1 = int(wp.clamp(high[0], 0.0, float(limit[0])))
    y1 = int(wp.clamp(high[1], 0.0, float(limit[1])))
    level = int(0)
    while level < pyramid.level_count - 1 and (x1 - x0 > 1 or y1 - y0 > 1):
        x0, y0, x1, y1 = x0 >> 1, y0 >> 1, x1 >> 1, y1 >> 1
        level += 1
    columns = pyramid.size[level][0]
    begin = pyramid.begin[level]
    top = wp.max(pyramid.keys[begin + y0 * columns + x0], pyramid.keys[begin + y0 * columns + x1])
    bottom = wp.max(pyramid.keys[begin + y1 * columns + x0], pyramid.keys[begin + y1 * columns + x1])
    return wp.max(top, bottom) < nearest


@wp.kernel
def find_pixel_depths_kernel(
    first: wp.int32,
    visibility: wp.array(dtype=wp.uint64),
    subpixels: wp.int32,
    columns: wp.int32,
    keys: wp.array(dtype=wp.uint32),
) -> None:
    pixel = first + wp.tid()
    y = pixel / columns
    x = pixel - y * columns
    farthest = wp.uint64(0)
    for sub_y in range(subpixels):
        row = (y * subpixels + sub_y) * columns * subpixels + x * subpixels
        for sub_x in range(subpixels):
            farthest = wp.max(farthest, visibility[row + sub_x])
    keys[pixel] = wp.uint32(farthest >> IDENTITY_BITS)


@wp.kernel
def halve_depths_kernel(first: wp.int32, level: wp.int32, pyramid: DepthPyramid) -> None:
    i = first + wp.tid()
    size, finer = pyramid.size[level], pyramid.size[level - 1]
    y = i / size[0]
    x = i - y * size[0]
    begin = pyramid.begin[level - 1]
    x0, y0 = 2 * x, 2 * y
    x1, y1 = wp.min(x0 + 1, finer[0] - 1), wp.min(y0 + 1, finer[1] - 1)
    top = wp.max(pyramid.keys[begin + y0 * finer[0] + x0], pyramid.keys[begin + y0 * finer[0] + x1])
    bottom = wp.max(pyramid.keys[begin + y1 * finer[0] + x0], pyramid.keys[begin + y1 * finer[0] + x1])
    pyramid.keys[pyramid.begin[level] + i] = wp.max(top, bottom)


def build_depth_pyramid(
    visibility: wp.array, width: int, height: int, subpixels: int, name: str, buffers: Buffers
) -> DepthPyramid:
    """Of a visibility buffer of width · height · subpixels² words, in the buffers called `name`."""
    sizes, begins, total = [(width, height)], [0], width * height
    while sizes[-1] != (1, 1) and len(sizes) < MOST_LEVELS:
        columns, rows = sizes[-1]
        sizes.append((-(-columns // 2), -(-rows // 2)))
        begins.append(total)
        total += sizes[-1][0] * sizes[-1][1]
    pyramid = DepthPyramid()
    pyramid.level_count = len(sizes)
    pyramid.size = wp.array(sizes, dtype=wp.vec2i, device=buffers.device)
    pyramid.begin = wp.array(begins, dtype=wp.int32, device=buffers.device)
    pyramid.keys = buffers.array(name, wp.uint32, total)
    inputs = [visibility, subpixels, width, pyramid.keys]
    launch(find_pixel_depths_kernel, width * height, inputs, buffers.device)
    for level in range(1, len(sizes)):
        columns, rows = sizes[level]
        launch(halve_depths_kernel, columns * rows, [level, pyramid], buffers.device)
    return pyramid
