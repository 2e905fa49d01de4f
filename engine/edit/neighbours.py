# SPDX-License-Identifier: GPL-3.0-or-later
"""Find splats by their neighbours: connected ones (flood), those near a set, those with few; grow and shrink."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import warp as wp

from ..device import launch
from ..errors import StippleError
from .affine import checked
from .editable_cloud import EditableCloud
from .mask import Mask, empty_mask, mask_from_hits
from .neighbour_grid import Grid, build_grid, first_cell, near, place_of, row_key
from .selection import select, selected_or_refuse
from .step import Step

wp.set_module_options({"enable_backward": False})

SAMPLES = 64  # splats whose spacing stands for the capture's
MOST_NEIGHBOURS = 32


@wp.func
def near_a_member(grid: Grid, cell: wp.int32, place: wp.int32) -> wp.bool:
    """Whether a splat is within reach of a member of another cell."""
    p = place_of(grid, place)
    for row in range(25):
        key = row_key(grid, cell, row)
        other = first_cell(grid, key)
        while other < grid.cell_count and grid.cell_keys[other] <= key + wp.uint64(4):
            for q in range(grid.cell_begins[other], grid.member_ends[other]):
                if near(grid, p, place_of(grid, q)):
                    return True
            other += 1
    return False


@wp.kernel
def match_near_kernel(first: wp.int32, grid: Grid, hits: wp.array(dtype=wp.uint8)) -> None:
    cell = first + wp.tid()
    begin = grid.cell_begins[cell]
    whole = grid.member_ends[cell] > begin
    for place in range(begin, grid.cell_begins[cell + 1]):
        hit = bool(whole)
        if not hit:
            hit = near_a_member(grid, cell, place)
        hits[grid.splats[place]] = wp.uint8(wp.where(hit, 1, 0))


@wp.kernel
def match_sparse_kernel(first: wp.int32, grid: Grid, neighbours: wp.int32, hits: wp.array(dtype=wp.uint8)) -> None:
    cell = first + wp.tid()
    begin = grid.cell_begins[cell]
    end = grid.cell_begins[cell + 1]
    if end - begin > neighbours:
        return
    for place in range(begin, end):
        p = place_of(grid, place)
        found = int(0)
        row = int(0)
        while row < 25 and found <= neighbours:
            key = row_key(grid, cell, row)
            other = first_cell(grid, key)
            while other < grid.cell_count and grid.cell_keys[other] <= key + wp.uint64(4) and found <= neighbours:
                q = grid.cell_begins[other]
                while q < grid.cell_begins[other + 1] and found <= neighbours:
                    if near(grid, p, place_of(grid, q)):
                        found += 1
                    q += 1
                other += 1
            row += 1
        if found <= neighbours:  # itself counts too
            hits[grid.splats[place]] = wp.uint8(1)


@wp.func
def cells_touch(grid: Grid, a: wp.int32, b: wp.int32) -> wp.bool:
    """Whether any splat of one cell is within reach of any of another."""
    for place in range(grid.cell_begins[a], grid.cell_begins[a + 1]):
        p = place_of(grid, place)
        for q in range(grid.cell_begins[b], grid.cell_begins[b + 1]):
            if near(grid, p, place_of(grid, q)):
                return True
    return False


@wp.kernel
def seed_cells_kernel(first: wp.int32, grid: Grid, rounds: wp.array(dtype=wp.int32)) -> None:
    cell = first + wp.tid()
    rounds[cell] = wp.where(grid.member_ends[cell] > grid.cell_begins[cell], 1, 0)


@wp.kernel
def flood_kernel(
    first: wp.int32,
    grid: Grid,
    frontier: wp.array(dtype=wp.int32),
    this_round: wp.int32,
    rounds: wp.array(dtype=wp.int32),  # in which a cell was reached; 0: not yet
) -> None:
    cell = frontier[first + wp.tid()]
    for row in range(25):
        key = row_key(grid, cell, row)
        other = first_cell(grid, key)
        while other < grid.cell_count and grid.cell_keys[other] <= key + wp.uint64(4):
            # Two threads that reach a cell at once write the same number.
            if rounds[other] == 0 and cells_touch(grid, cell, other):
                rounds[other] = this_round + 1
            other += 1


@wp.kernel
def reached_splats_kernel(
    first: wp.int32, grid: Grid, rounds: wp.array(dtype=wp.int32), hits: wp.array(dtype=wp.uint8)
) -> None:
    cell = first + wp.tid()
    if rounds[cell] > 0:
        for place in range(grid.cell_begins[cell], grid.cell_begins[cell + 1]):
            hits[grid.splats[place]] = wp.uint8(1)


@wp.kernel
def spacing_kernel(
    first: wp.int32,
    position: wp.array(dtype=wp.vec3),
    rows: wp.array(dtype=wp.int32),
    samples: wp.int32,
    neighbours: wp.int32,
    linear: wp.mat33,
    squared: wp.array2d(dtype=wp.float32),
) -> None:
    j = first + wp.tid()
    at = int(wp.int64(j) * wp.int64(rows.shape[0]) / wp.int64(samples))
    p = position[rows[at]]
    for k in range(neighbours + 1):
        squared[j, k] = 3.0e38
    for i in range(rows.shape[0]):
        d = wp.length_sq(linear * (position[rows[i]] - p))
        if d < squared[j, neighbours]:
            k = int(neighbours)
            while k > 0 and squared[j, wp.max(k - 1, 0)] > d:
                squared[j, k] = squared[j, k - 1]
                k -= 1
            squared[j, k] = d


def match_near(
    cloud: EditableCloud, members: Mask, distance: float, world_from_object: npt.ArrayLike | None = None
) -> Mask:
    """Selectable splats within `distance` [world units] of any of `members`, those among them included."""
    part = cloud.selectable()
    grid, _count = build_grid(cloud, part | members, members, distance, world_from_object)
    hits = cloud.hits()
    hits.zero_()
    launch(match_near_kernel, grid.cell_count, [grid, hits], cloud.device)
    return mask_from_hits(hits, cloud.splat_count) & part


def match_connected(
    cloud: EditableCloud,
    seeds: Mask,
    distance: float,
    world_from_object: npt.ArrayLike | None = None,
    within: Mask | None = None,
) -> Mask:
    """Selectable splats, of `within` only if given, that a chain of steps of at most `distance` links to a seed.

    With a colour match as `within` it floods one colour. Seeds outside do not count. World units.
    """
    part = cloud.selectable() if within is None else cloud.selectable() & within
    grid, count = build_grid(cloud, part, seeds & part, distance, world_from_object)
    if count == 0:
        return empty_mask(cloud.splat_count, cloud.device)
    rounds = wp.empty(grid.cell_count, dtype=wp.int32, device=cloud.device)
    launch(seed_cells_kernel, grid.cell_count, [grid, rounds], cloud.device)
    this_round = 1
    frontier = np.flatnonzero(rounds.numpy() == this_round)
    while len(frontier):
        cells = wp.array(frontier.astype(np.int32), dtype=wp.int32, device=cloud.device)
        launch(flood_kernel, cells.size, [grid, cells, this_round, rounds], cloud.device, smallest_chunk=64)
        this_round += 1
        frontier = np.flatnonzero(rounds.numpy() == this_round)
    hits = cloud.hits()
    hits.zero_()
    launch(reached_splats_kernel, grid.cell_count, [grid, rounds, hits], cloud.device)
    return mask_from_hits(hits, cloud.splat_count)


def match_sparse(
    cloud: EditableCloud, distance: float, neighbours: int = 6, world_from_object: npt.ArrayLike | None = None
) -> Mask:
    """Selectable splats with fewer than `neighbours` others within `distance` [world units]: floaters.

    Locked splats are seen, so they keep others company.
    """
    if neighbours < 1:
        raise StippleError(f"floaters: {neighbours} neighbours; give at least 1.")
    part = cloud.shown()
    grid, _count = build_grid(cloud, part, part, distance, world_from_object)
    hits = cloud.hits()
    hits.zero_()
    launch(match_sparse_kernel, grid.cell_count, [grid, neighbours, hits], cloud.device)
    return mask_from_hits(hits, cloud.splat_count) & cloud.selectable()


def grow(cloud: EditableCloud, distance: float, world_from_object: npt.ArrayLike | None = None) -> Step:
    """The step that also selects what is within `distance` of the selection. Raises StippleError for an empty one."""
    near_it = match_near(cloud, selected_or_refuse(cloud, "grow"), distance, world_from_object)
    return select(cloud, near_it, "add", "Grow Selection")


def shrink(cloud: EditableCloud, distance: float, world_from_object: npt.ArrayLike | None = None) -> Step:
    """The step that deselects what is within `distance` of what is selectable and not selected.

    Raises StippleError when nothing is selected.
    """
    rest = cloud.selectable() - selected_or_refuse(cloud, "shrink")
    return select(cloud, match_near(cloud, rest, distance, world_from_object), "subtract", "Shrink Selection")


def typical_spacing(cloud: EditableCloud, neighbours: int = 6, world_from_object: npt.ArrayLike | None = None) -> float:
    """Median distance of shown splats to their `neighbours`th nearest, of 64 spread over the list [world units].

    A scale for the distances that the functions above ask for, which locking splats does not change; of fewer splats
    the distance to the farthest. Raises StippleError for fewer than two, and where they lie on each other.
    """
    if not 1 <= neighbours <= MOST_NEIGHBOURS:
        raise StippleError(f"{cloud.name}: {neighbours} neighbors; ask for 1 to {MOST_NEIGHBOURS}.")
    rows = cloud.shown().indices()
    if rows.size < 2:
        raise StippleError(f"{cloud.name}: distances are between splats, and fewer than two are shown; reveal some.")
    neighbours = min(neighbours, rows.size - 1)
    samples = min(SAMPLES, rows.size)
    squared = wp.empty((samples, neighbours + 1), dtype=wp.float32, device=cloud.device)
    linear = wp.mat33(*checked(world_from_object, "world_from_object")[:, :3].ravel())
    inputs = [cloud.array("position"), rows, samples, neighbours, linear, squared]
    launch(spacing_kernel, samples, inputs, cloud.device, smallest_chunk=1)
    spacing = float(np.sqrt(np.median(squared.numpy()[:, neighbours])))
    if spacing == 0.0:
        raise StippleError(f"{cloud.name}: its splats lie on each other with no distance between them; move some away.")
    return spacing
