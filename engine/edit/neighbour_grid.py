# SPDX-License-Identifier: GPL-3.0-or-later
"""A grid of cells for one question about neighbours: built, asked and thrown away.

Cells are so small that any two splats of one cell are neighbours: their diagonal is the distance asked about. So a
dense cell is answered as a whole, and only the cells around the edge of an answer compare splats with splats. All
neighbours of a cell are among the 124 around it. Distances are in the world and in float64; answers are the same
whatever the number of threads.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import warp as wp

from ..buffers import allocate
from ..device import launch
from ..errors import StippleError
from .affine import checked
from .editable_cloud import EditableCloud
from .mask import EDIT_LESS, Mask, has_bit

wp.set_module_options({"enable_backward": False})

AXIS_BITS = 20
MARGIN = wp.constant(wp.int64(2))  # cells around the grid, so that a neighbour's number never wraps
AXIS_SHIFT = wp.constant(wp.uint64(AXIS_BITS + 1))


@wp.struct
class Grid:
    """Splats sorted by cell; within a cell, members come first."""

    position: wp.array(dtype=wp.vec3)
    linear: wp.mat33d  # world from object, without the translation
    reach_squared: wp.float64
    splats: wp.array(dtype=wp.int32)  # by place
    cell_keys: wp.array(dtype=wp.uint64)  # ascending
    cell_begins: wp.array(dtype=wp.int32)  # places; one more than there are cells
    member_ends: wp.array(dtype=wp.int32)  # place after each cell's last member
    cell_count: wp.int32


@wp.func
def place_of(grid: Grid, place: wp.int32) -> wp.vec3d:
    p = grid.position[grid.splats[place]]
    return grid.linear * wp.vec3d(wp.float64(p[0]), wp.float64(p[1]), wp.float64(p[2]))


@wp.func
def key_of(x: wp.int64, y: wp.int64, z: wp.int64) -> wp.uint64:
    return (((wp.uint64(x) << AXIS_SHIFT) | wp.uint64(y)) << AXIS_SHIFT) | wp.uint64(z)


@wp.func
def near(grid: Grid, a: wp.vec3d, b: wp.vec3d) -> wp.bool:
    d = a - b
    return wp.dot(d, d) <= grid.reach_squared


@wp.func
def first_cell(grid: Grid, key: wp.uint64) -> wp.int32:
    """The first cell whose key is not below `key`."""
    low = int(0)
    high = int(grid.cell_count)
    while low < high:
        middle = (low + high) // 2
        if grid.cell_keys[middle] < key:
            low = middle + 1
        else:
            high = middle
    return low


@wp.func
def row_key(grid: Grid, cell: wp.int32, row: wp.int32) -> wp.uint64:
    """Key of the first of five cells along z in one of the 25 rows around a cell."""
    key = grid.cell_keys[cell]
    step_x = wp.uint64(row // 5) << (AXIS_SHIFT + AXIS_SHIFT)
    step_y = wp.uint64(row % 5) << AXIS_SHIFT
    two = (wp.uint64(2) << (AXIS_SHIFT + AXIS_SHIFT)) + (wp.uint64(2) << AXIS_SHIFT) + wp.uint64(2)
    return key + step_x + step_y - two


@wp.kernel
def find_cells_kernel(
    first: wp.int32,
    rows: wp.array(dtype=wp.int32),
    position: wp.array(dtype=wp.vec3),
    linear: wp.mat33d,
    low: wp.vec3d,
    inverse_side: wp.float64,
    members: wp.array(dtype=wp.uint32),
    keys: wp.array(dtype=wp.uint64),
    splats: wp.array(dtype=wp.int32),
) -> None:
    j = first + wp.tid()
    i = rows[j]
    p = position[i]
    q = (linear * wp.vec3d(wp.float64(p[0]), wp.float64(p[1]), wp.float64(p[2])) - low) * inverse_side
    key = key_of(
        wp.int64(wp.floor(q[0])) + MARGIN, wp.int64(wp.floor(q[1])) + MARGIN, wp.int64(wp.floor(q[2])) + MARGIN
    )
    last = wp.uint64(1)
    if has_bit(members, i):
        last = wp.uint64(0)
    keys[j] = (key << wp.uint64(1)) | last
    splats[j] = i


@wp.kernel
def mark_cells_kernel(first: wp.int32, keys: wp.array(dtype=wp.uint64), begins: wp.array(dtype=wp.int32)) -> None:
    j = first + wp.tid()
    begin = int(1)
    if j > 0 and (keys[j] >> wp.uint64(1)) == (keys[j - 1] >> wp.uint64(1)):
        begin = 0
    begins[j] = begin


@wp.kernel
def list_cells_kernel(
    first: wp.int32,
    keys: wp.array(dtype=wp.uint64),
    numbers: wp.array(dtype=wp.int32),  # inclusive sum of the cells' first places
    count: wp.int32,
    cell_keys: wp.array(dtype=wp.uint64),
    cell_begins: wp.array(dtype=wp.int32),
    member_ends: wp.array(dtype=wp.int32),
) -> None:
    j = first + wp.tid()
    cell = numbers[j] - 1
    begins = j == 0 or numbers[j - 1] != numbers[j]
    member = (keys[j] & wp.uint64(1)) == wp.uint64(0)
    if begins:
        cell_keys[cell] = keys[j] >> wp.uint64(1)
        cell_begins[cell] = j
        if not member:
            member_ends[cell] = j
    if member:
        after = j + 1
        ends = bool(after == count)
        if not ends:
            ends = numbers[after] != numbers[j] or (keys[after] & wp.uint64(1)) != wp.uint64(0)
        if ends:
            member_ends[cell] = after
    if j == count - 1:
        cell_begins[cell + 1] = count


def build_grid(
    cloud: EditableCloud,
    taking_part: Mask,
    members: Mask,
    distance: float,
    world_from_object: npt.ArrayLike | None,
) -> tuple[Grid, int]:
    """A grid of the splats `taking_part`, of which `members` come first in each cell, and how many take part.

    Raises StippleError for a distance that is not positive, or so small that a million cells do not span the splats.
    """
    if not (np.isfinite(distance) and distance > 0):
        raise StippleError(f"neighbour distance is {distance}; give a finite value above 0.")
    linear = checked(world_from_object, "world_from_object")[:, :3]
    device, rows = cloud.device, taking_part.indices()
    count, grid = int(rows.size), Grid()
    grid.position, grid.linear, grid.reach_squared = cloud.array("position"), wp.mat33d(*linear.ravel()), distance**2
    if count == 0:
        return grid, 0
    side = distance / np.sqrt(3.0) * (1 - 1e-9)
    low = _lowest_corner(cloud, taking_part, linear, side)
    # Twice the room: the sort keeps its other half there.
    keys = allocate(device, wp.uint64, 2 * count, "a search for neighbours", EDIT_LESS)
    splats = allocate(device, wp.int32, 2 * count, "a search for neighbours", EDIT_LESS)
    inputs = [rows, grid.position, grid.linear, wp.vec3d(*low), 1.0 / side, members.words, keys, splats]
    launch(find_cells_kernel, count, inputs, device)
    wp.utils.radix_sort_pairs(keys, splats, count)
    numbers = rows  # its memory is free now
    launch(mark_cells_kernel, count, [keys, numbers], device)
    wp.utils.array_scan(numbers, numbers, inclusive=True)
    grid.cell_count = int(numbers[-1:].numpy()[0])
    grid.splats = splats
    grid.cell_keys = allocate(device, wp.uint64, grid.cell_count, "a search for neighbours", EDIT_LESS)
    grid.cell_begins = allocate(device, wp.int32, grid.cell_count + 1, "a search for neighbours", EDIT_LESS)
    grid.member_ends = allocate(device, wp.int32, grid.cell_count, "a search for neighbours", EDIT_LESS)
    listed = [keys, numbers, count, grid.cell_keys, grid.cell_begins, grid.member_ends]
    launch(list_cells_kernel, count, listed, device)
    return grid, count


def _lowest_corner(
    cloud: EditableCloud, taking_part: Mask, linear: npt.NDArray[np.float64], side: float
) -> npt.NDArray[np.float64]:
    """The grid's corner in the turned space; from the box around the box, which is all it takes. Reads back."""
    means = cloud.host("position")[taking_part.numpy()]
    middle = (means.max(axis=0).astype(np.float64) + means.min(axis=0)) / 2
    half = np.abs(linear) @ (means.max(axis=0).astype(np.float64) - means.min(axis=0)) / 2
    cells = 2 * half.max() / side
    if not cells < (1 << AXIS_BITS) - 8:
        raise StippleError(
            f"{cloud.name}: a neighbour distance of {side * np.sqrt(3.0):g} cuts the capture into too many cells; "
            f"give at least {2 * half.max() / (1 << AXIS_BITS) * 1.8:g}, or select fewer far-off splats."
        )
    return linear @ middle - half - side / 2
