# SPDX-License-Identifier: GPL-3.0-or-later
"""The plan of a generated city: streets, courtyards, houses and trees as textured parallelograms, on the host.

Model space: x east, y north, z up [m], the middle of the city at the origin. Blocks are in Morton order and what
belongs to a block follows each other, so that splats cut from consecutive surfaces are neighbours.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

# What a surface is made of; `city_materials` knows how it looks.
FIELD, STREET, COURTYARD, FACADE, CURTAIN_WALL, FLAT_ROOF, TILED_ROOF, TREE = range(8)

BLOCK = np.array([84.0, 66.0])  # of one block [m]
STREET_WIDTH = 18.0  # between blocks, pavements included [m]
PAVEMENT_WIDTH = 4.0
PITCH = BLOCK + STREET_WIDTH
LOT_DEPTH = 20.0  # of houses, behind which the courtyard begins [m]
PARAPET = 0.9  # of flat roofs [m]
CELL = 2.0  # of the map of heights [m]
TREE_SPACING = 11.0  # along a street [m]
FIELDS_BESIDE = 500.0  # how far the land around the city reaches [m]

Vector = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Surface:
    """A parallelogram: `origin` at a lower corner, `across` and `up` its sides; up × across points inwards.

    `taper` narrows it towards the top: 1 makes a gable. Of a tree, `origin` is the foot, `across` the radius and `up`
    the height.
    """

    kind: int
    seed: int
    origin: tuple[float, float, float]
    across: tuple[float, float, float]
    up: tuple[float, float, float]
    taper: float = 0.0


@dataclass
class Plan:
    """All surfaces, and the height of what stands on each cell of the ground, (rows along y, columns along x) [m]."""

    half_size: Vector
    surfaces: list[Surface] = field(default_factory=list)
    heights: npt.NDArray[np.float32] = field(default_factory=lambda: np.zeros((1, 1), np.float32))

    def occupy(self, low: Vector, high: Vector, height: float) -> None:
        first, last = ((np.asarray(corner) + self.half_size) / CELL for corner in (low, high))
        columns, rows = (slice(round(first[axis]), round(last[axis])) for axis in (0, 1))
        self.heights[rows, columns] = np.maximum(self.heights[rows, columns], height)


def plan_city(blocks_per_side: int, seed: int) -> Plan:
    """A city of blocks_per_side² blocks, with fields around. Equal arguments give equal plans."""
    rng = np.random.default_rng(seed)
    plan = Plan(half_size=0.5 * (blocks_per_side * PITCH + STREET_WIDTH))
    size = np.ceil(2 * plan.half_size / CELL).astype(int)
    plan.heights = np.zeros((size[1], size[0]), np.float32)
    _fields(plan)
    for column, row in _morton_cells(blocks_per_side):
        corner = np.array([column, row]) * PITCH - plan.half_size + STREET_WIDTH
        _streets(plan, corner, last=np.array([column, row]) == blocks_per_side - 1)
        middle = np.linalg.norm((corner + BLOCK / 2) / plan.half_size)
        if rng.random() < 0.06 and middle > 0.2:
            _park(plan, corner, rng)
        else:
            _houses(plan, corner, float(middle), rng)
        _street_trees(plan, corner, rng)
    return plan


def _morton_cells(side: int) -> list[tuple[int, int]]:
    def code(cell: tuple[int, int]) -> int:
        return sum(((cell[axis] >> bit) & 1) << (2 * bit + axis) for bit in range(16) for axis in (0, 1))

    return sorted(((column, row) for column in range(side) for row in range(side)), key=code)


def _ground(plan: Plan, kind: int, low: Vector, high: Vector, z: float = 0.0) -> None:
    """A horizontal rectangle, longer along `across`."""
    width, depth = high - low
    if width >= depth:
        sides = ((width, 0.0, 0.0), (0.0, depth, 0.0))
        origin = (low[0], low[1], z)
    else:
        sides = ((0.0, depth, 0.0), (-width, 0.0, 0.0))
        origin = (high[0], low[1], z)
    plan.surfaces.append(Surface(kind, len(plan.surfaces), origin, *sides))


def _fields(plan: Plan) -> None:
    """Land around the city, in pieces of some 100 m."""
    inner, beside = plan.half_size, np.linspace(0.0, FIELDS_BESIDE, 5)[1:]
    edges = []
    for axis in (0, 1):
        within = np.linspace(-inner[axis], inner[axis], max(2, round(float(inner[axis]) / 50.0)))
        edges.append(np.concatenate([-inner[axis] - beside[::-1], within, inner[axis] + beside]))
    for column, row in _morton_cells(max(len(edge) for edge in edges) - 1):
        if column + 1 >= len(edges[0]) or row + 1 >= len(edges[1]):
            continue
        low = np.array([edges[0][column], edges[1][row]])
        high = np.array([edges[0][column + 1], edges[1][row + 1]])
        if (np.abs(0.5 * (low + high)) > inner).any():
            _ground(plan, FIELD, low, high, -0.4)


def _streets(plan: Plan, corner: Vector, last: npt.NDArray[np.bool_]) -> None:
    """The streets south and west of a block and their crossing; of the last blocks also those beyond."""
    east, north = corner[0] + BLOCK[0], corner[1] + BLOCK[1]
    w = STREET_WIDTH
    wests = [corner[0] - w] + ([east] if last[0] else [])
    souths = [corner[1] - w] + ([north] if last[1] else [])
    for south in souths:
        _ground(plan, STREET, np.array([corner[0], south]), np.array([east, south + w]))
    for west in wests:
        _ground(plan, STREET, np.array([west, corner[1]]), np.array([west + w, north]))
    for west in wests:
        for south in souths:
            _ground(plan, STREET, np.array([west, south]), np.array([west + w, south + w]))


def _park(plan: Plan, corner: Vector, rng: np.random.Generator) -> None:
    _ground(plan, COURTYARD, corner, corner + BLOCK)
    for _ in range(36):
        _tree(plan, corner + (0.06 + 0.88 * rng.random(2)) * BLOCK, rng, 1.3)


def _houses(plan: Plan, corner: Vector, middle: float, rng: np.random.Generator) -> None:
    """Two rows of houses along the streets with a courtyard between them, higher towards the middle of the city."""
    depth = LOT_DEPTH
    _ground(plan, COURTYARD, np.add(corner, (0, depth)), corner + BLOCK - np.array([0, depth]))
    for _ in range(4):
        _tree(plan, np.add(corner, (8 + 68 * rng.random(), BLOCK[1] / 2 + rng.uniform(-4, 4))), rng, 0.9)
    for south in (corner[1], corner[1] + BLOCK[1] - depth):
        widths = _lot_widths(rng)
        heights = [_height(middle, rng) for _ in widths]
        west = corner[0]
        for index, (width, height) in enumerate(zip(widths, heights, strict=True)):
            beside = (heights[index - 1] if index else 0.0, heights[index + 1] if index + 1 < len(heights) else 0.0)
            _house(plan, np.array([west, south]), np.array([width, depth]), height, beside, rng)
            west += width


def _lot_widths(rng: np.random.Generator) -> list[float]:
    """Of houses in a row that fills a block, in whole cells of the map of heights."""
    left, widths = round(BLOCK[0] / CELL), []
    while left >= 14:
        width = int(rng.integers(6, 12))
        width = width if left - width >= 6 else left
        widths.append(width * CELL)
        left -= width
    return [*widths, left * CELL] if left else widths


def _height(middle: float, rng: np.random.Generator) -> float:
    storeys = rng.integers(3, 7) + int(rng.random() < 0.5) * rng.integers(0, 3)
    if rng.random() < 0.3 * max(0.0, 1.0 - 1.6 * middle):
        storeys += rng.integers(6, 18)
    return 4.2 + 3.2 * int(storeys - 1)


def _house(
    plan: Plan, low: Vector, size: Vector, height: float, beside: tuple[float, float], rng: np.random.Generator
) -> None:
    """A box with a flat or a gabled roof; walls that neighbours hide are left out. `beside`: heights west, east."""
    seed = int(rng.integers(1 << 30))
    tower = height > 34.0
    kind = CURTAIN_WALL if tower and rng.random() < 0.7 else FACADE
    gabled = not tower and rng.random() < 0.6
    top = height if gabled else height + PARAPET
    west, south = low
    east, north = low + size
    plan.surfaces.append(Surface(kind, seed, (west, south, 0.0), (size[0], 0, 0), (0, 0, top)))
    plan.surfaces.append(Surface(kind, seed, (east, north, 0.0), (-size[0], 0, 0), (0, 0, top)))
    for x, begin, step, other in ((west, north, -size[1], beside[0]), (east, south, size[1], beside[1])):
        if other < top - 0.5:
            plan.surfaces.append(Surface(kind, seed, (x, begin, other), (0, step, 0), (0, 0, top - other)))
    if not gabled:
        plan.surfaces.append(Surface(FLAT_ROOF, seed, (west, south, height), (size[0], 0, 0), (0, size[1], 0)))
        plan.occupy(low, low + size, top)
        if size[0] > 14:
            _roof_box(plan, low + size * (0.3 + 0.3 * rng.random(2)), height, seed)
        return
    rise = 0.5 * size[1] * 0.75
    ridge = (0.0, 0.5 * size[1], rise)
    plan.surfaces.append(Surface(TILED_ROOF, seed, (west, south, height), (size[0], 0, 0), ridge))
    back = (0.0, -0.5 * size[1], rise)
    plan.surfaces.append(Surface(TILED_ROOF, seed, (east, north, height), (-size[0], 0, 0), back))
    for x, begin, step in ((west, north, -size[1]), (east, south, size[1])):
        plan.surfaces.append(Surface(FACADE, seed, (x, begin, height), (0, step, 0), (0, 0, rise), taper=1.0))
    quarter = np.array([0.0, 0.25 * size[1]])
    plan.occupy(low, low + size, height + 0.3 * rise)
    plan.occupy(low + quarter, low + size - quarter, height + 0.75 * rise)


def _roof_box(plan: Plan, low: Vector, z: float, seed: int) -> None:
    """What stands on a flat roof: the head of a lift."""
    x, y, w, d, h = low[0], low[1], 4.0, 4.0, 2.6
    for origin, across in (
        ((x, y, z), (w, 0, 0)),
        ((x + w, y, z), (0, d, 0)),
        ((x + w, y + d, z), (-w, 0, 0)),
        ((x, y + d, z), (0, -d, 0)),
    ):
        plan.surfaces.append(Surface(FLAT_ROOF, seed + 1, origin, across, (0, 0, h)))
    plan.surfaces.append(Surface(FLAT_ROOF, seed + 1, (x, y, z + h), (w, 0, 0), (0, d, 0)))


def _street_trees(plan: Plan, corner: Vector, rng: np.random.Generator) -> None:
    """Along the south and the west of a block, on its pavement."""
    for axis in (0, 1):
        for step in np.arange(5.0, BLOCK[axis] - 4.0, TREE_SPACING):
            if rng.random() < 0.75:
                foot = corner.copy()
                foot[axis] += step + rng.uniform(-0.8, 0.8)
                foot[1 - axis] -= 3.0
                _tree(plan, foot, rng, 0.8)


def _tree(plan: Plan, foot: Vector, rng: np.random.Generator, size: float) -> None:
    radius, height = size * rng.uniform(2.0, 3.0), size * rng.uniform(6.5, 9.5)
    seed = int(rng.integers(1 << 30))
    plan.surfaces.append(Surface(TREE, seed, (foot[0], foot[1], 0.0), (radius, 0, 0), (0, 0, height)))
