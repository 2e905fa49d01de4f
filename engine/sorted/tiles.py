# SPDX-License-Identifier: GPL-3.0-or-later
"""Cut splats into tile fragments and group them by tile, front to back in each.

Splatshop tests every tile of a splat's bounding box with an approximate circle-ellipse test that may miss tiles. Here
each row of tiles is intersected with the ellipse exactly, which gives the row's first and last tile directly: no
false negatives, no false positives, no loop over columns.
"""

from __future__ import annotations

from dataclasses import dataclass

import warp as wp

from ..buffers import Buffers
from ..device import launch
from ..maths.projection import View
from .order import Ordered

wp.set_module_options({"enable_backward": False})

TILE_PX = 16
TILE = wp.constant(float(TILE_PX))
EDGE_PX = wp.constant(0.01)  # a pixel that rounding puts just inside a splat must not miss it


@dataclass(frozen=True)
class Tiles:
    """Fragments grouped by tile: those of tile t are `order_from_fragment[begin[t]:end[t]]`."""

    columns: int
    rows: int
    fragment_count: int
    order_from_fragment: wp.array
    begin: wp.array
    end: wp.array


@wp.struct
class TileGrid:
    """Tiles over the rendered window."""

    corner: wp.vec2  # of the window in the frame [px]
    columns: wp.int32
    rows: wp.int32


@wp.func
def tile_rows(y: wp.float32, half_height: wp.float32, rows: wp.int32) -> wp.vec2i:
    """First row of tiles that the support touches, and the row after the last."""
    limit = float(rows)
    low = wp.clamp(wp.floor((y - half_height) / TILE), 0.0, limit)
    high = wp.clamp(wp.floor((y + half_height) / TILE) + 1.0, 0.0, limit)
    return wp.vec2i(int(low), int(high))


@wp.func
def tile_span(mean: wp.vec2, reach2: wp.float32, covariance: wp.vec4, row: wp.int32, columns: wp.int32) -> wp.vec2i:
    """First tile of a row of tiles that the support touches, and the tile after the last.

    The ellipse's right edge over y is concave and peaks where it touches its bounding box, so its largest x over the
    row's heights is at that point, clamped to them; the left edge mirrors it.
    """
    xx, xy, yy, determinant = covariance[0], covariance[1], covariance[2], covariance[3]
    half_height = wp.sqrt(reach2 * yy)
    low = wp.max(float(row) * TILE - mean[1], -half_height)
    high = wp.min(float(row + 1) * TILE - mean[1], half_height)
    touch = xy * wp.sqrt(reach2 / xx)
    y_right = wp.clamp(touch, low, high)
    y_left = wp.clamp(-touch, low, high)
    right = xy / yy * y_right + wp.sqrt(wp.max(reach2 - y_right * y_right / yy, 0.0) * determinant / yy)
    left = xy / yy * y_left - wp.sqrt(wp.max(reach2 - y_left * y_left / yy, 0.0) * determinant / yy)
    limit = float(columns)
    first = wp.clamp(wp.floor((mean[0] + left - EDGE_PX) / TILE), 0.0, limit)
    last = wp.clamp(wp.floor((mean[0] + right + EDGE_PX) / TILE) + 1.0, 0.0, limit)
    return wp.vec2i(int(first), int(last))


@wp.kernel
def count_fragments_kernel(first: wp.int32, ordered: Ordered, grid: TileGrid, counts: wp.array(dtype=wp.int64)) -> None:
    j = first + wp.tid()
    place = ordered.place[j]
    count = wp.int64(0)
    if place[3] < 0.0:
        covariance = ordered.covariance[j]
        mean = wp.vec2(place[0], place[1]) - grid.corner
        span_rows = tile_rows(mean[1], ordered.shape[j][3], grid.rows)
        for row in range(span_rows[0], span_rows[1]):
            span = tile_span(mean, -2.0 * place[3], covariance, row, grid.columns)
            count += wp.int64(wp.max(span[1] - span[0], 0))
    counts[j] = count


@wp.kernel
def write_fragments_kernel(
    first: wp.int32,
    ordered: Ordered,
    grid: TileGrid,
    first_fragment: wp.array(dtype=wp.int64),
    tile_from_fragment: wp.array(dtype=wp.int32),
    order_from_fragment: wp.array(dtype=wp.int32),
) -> None:
    j = first + wp.tid()
    place = ordered.place[j]
    if not place[3] < 0.0:
        return
    covariance = ordered.covariance[j]
    fragment = first_fragment[j]
    mean = wp.vec2(place[0], place[1]) - grid.corner
    span_rows = tile_rows(mean[1], ordered.shape[j][3], grid.rows)
    for row in range(span_rows[0], span_rows[1]):
        span = tile_span(mean, -2.0 * place[3], covariance, row, grid.columns)
        for column in range(span[0], span[1]):
            tile_from_fragment[fragment] = row * grid.columns + column
            order_from_fragment[fragment] = j
            fragment += wp.int64(1)


@wp.kernel
def find_tile_ranges_kernel(
    first: wp.int32,
    tile_from_fragment: wp.array(dtype=wp.int32),
    count: wp.int32,
    begin: wp.array(dtype=wp.int32),
    end: wp.array(dtype=wp.int32),
) -> None:
    f = first + wp.tid()
    tile = tile_from_fragment[f]
    if f == 0 or tile_from_fragment[f - 1] != tile:
        begin[tile] = f
    if f == count - 1 or tile_from_fragment[f + 1] != tile:
        end[tile] = f + 1


def row_ranges(tiles: Tiles, most: int) -> list[tuple[int, int]]:
    """Consecutive rows of tiles (first, after the last), each range with at most `most` fragments or a single row.

    Reads the tiles' ranges back.
    """
    per_row = (tiles.end.numpy() - tiles.begin.numpy()).reshape(tiles.rows, tiles.columns).sum(axis=1)
    ranges, first, held = [], 0, 0
    for row, count in enumerate(per_row.tolist()):
        if held and held + count > most:
            ranges.append((first, row))
            first, held = row, 0
        held += count
    return [*ranges, (first, tiles.rows)]


def cut_into_tiles(ordered: Ordered, count: int, view: View, buffers: Buffers) -> Tiles:
    """Fragments of `count` ordered splats, sorted by tile. Reads back the fragment count."""
    device = buffers.device
    grid = TileGrid()
    grid.corner = view.window_low
    size_px = view.window_high - view.window_low
    columns, rows = (-(-int(size) // TILE_PX) for size in size_px)
    grid.columns, grid.rows = columns, rows
    counts = buffers.array("fragment_counts", wp.int64, count)
    first_fragment = buffers.array("first_fragment", wp.int64, count)
    fragment_count = 0
    if count:
        launch(count_fragments_kernel, count, [ordered, grid, counts], device)
        wp.utils.array_scan(counts, first_fragment, inclusive=False)
        fragment_count = int(first_fragment[-1:].numpy()[0] + counts[-1:].numpy()[0])
    tile_from_fragment = buffers.array("tile_from_fragment", wp.int32, 2 * fragment_count)
    order_from_fragment = buffers.array("order_from_fragment", wp.int32, 2 * fragment_count)
    begin = buffers.array("tile_begin", wp.int32, columns * rows)
    end = buffers.array("tile_end", wp.int32, columns * rows)
    begin.zero_()
    end.zero_()
    if fragment_count:
        inputs = [ordered, grid, first_fragment, tile_from_fragment, order_from_fragment]
        launch(write_fragments_kernel, count, inputs, device)
        # Stable, so each tile keeps the depth order. Only the bits a tile number has are sorted.
        bits = max(1, (columns * rows - 1).bit_length())
        wp.utils.radix_sort_pairs(tile_from_fragment, order_from_fragment, fragment_count, end_bit=bits)
        launch(find_tile_ranges_kernel, fragment_count, [tile_from_fragment, fragment_count, begin, end], device)
    return Tiles(columns, rows, fragment_count, order_from_fragment, begin, end)
