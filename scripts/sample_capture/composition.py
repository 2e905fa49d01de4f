# SPDX-License-Identifier: GPL-3.0-or-later
"""The still life: what stands where. Three mushrooms lead, stones and ferns stand behind them, leaves lie about."""

from __future__ import annotations

import numpy as np

from .branches import Branch, branch
from .leaves import fallen_leaf, needles
from .moss import moss_fibres, sporophytes
from .mushrooms import Mushroom, mushroom
from .noise import FloatArray, NoiseField
from .plants import fern, grass
from .rocks import Boulder, boulder
from .snail import snail
from .surfels import Surfels, join
from .terrain import FULL_TURN, Terrain, forest_floor, sawn_wood, trunk_bark

# At a spacing of 1 the things need about AREA_COUNT splats, and FIXED_COUNT more at any spacing: blades, needles.
AREA_COUNT, FIXED_COUNT = 207_000, 6_000
MOSS_SHARE = 0.15  # of all splats, at least

MUSHROOMS = (
    Mushroom(0.00, 0.0, 0.66, 0.37, 0.56, (-0.05, -0.06), 66),
    Mushroom(0.40, -0.26, 0.37, 0.235, 0.74, (0.08, -0.06), 48, 0.9),
    Mushroom(-0.30, -0.37, 0.17, 0.135, 0.98, (-0.03, -0.02), 40, 0.8),
)
BOULDERS = (
    Boulder(-0.50, 0.34, (0.37, 0.31, 0.32), 0.25, 1.0, detail=0.85),
    Boulder(0.50, 0.46, (0.24, 0.20, 0.18), 0.3, 0.9, "96897a"),
    Boulder(-0.72, -0.30, (0.12, 0.10, 0.08), 0.3, 0.4, "9a948c"),
    Boulder(0.12, -0.70, (0.075, 0.06, 0.045), 0.3, 0.0, "a39a8c", 0.8),
    Boulder(0.22, -0.76, (0.04, 0.05, 0.03), 0.3, 0.0, "7f7a76", 0.8),
)
BRANCH = Branch((0.30, -0.62), (0.98, -0.02), 0.062, 0.03)
SNAIL = (-0.02, -0.60)
# x, y, heading [rad], length [units]
FERNS = (
    (0.20, 0.44, 1.2, 1.15), (0.24, 0.42, 0.2, 1.0), (0.16, 0.46, 2.0, 1.15), (0.24, 0.40, -0.35, 0.75),
    (0.18, 0.48, 2.7, 1.1), (0.22, 0.46, 0.7, 1.2), (-0.86, 0.30, 2.6, 0.55), (-0.84, 0.36, 1.7, 0.65),
    (-0.88, 0.26, 3.4, 0.5), (0.74, 0.22, 0.1, 0.6), (0.72, 0.26, 1.4, 0.62), (0.74, 0.24, 2.5, 0.5),
)  # fmt: skip
# Maple leaves that lead the eye in from the front: x, y, size [units]; the others fall where they may.
LEADING_LEAVES = (
    (-0.20, -0.82, 0.16), (-0.06, -0.87, 0.13), (-0.47, -0.63, 0.14), (0.31, -0.87, 0.15), (-0.78, -0.56, 0.12),
    (-0.33, -0.70, 0.09), (0.66, -0.60, 0.14),
)  # fmt: skip
# x, y, blade count, height [units]
TUFTS = np.array(
    [
        [-0.62, 0.02, 34, 0.34], [-0.55, -0.06, 22, 0.26], [0.70, 0.16, 30, 0.36], [0.62, 0.24, 26, 0.42],
        [-0.05, 0.62, 40, 0.55], [0.22, 0.55, 34, 0.50], [0.20, 0.12, 16, 0.30], [-0.86, -0.12, 24, 0.22],
        [-0.50, -0.62, 16, 0.17], [0.55, -0.70, 14, 0.18], [-0.80, 0.50, 26, 0.30], [-0.1, -0.42, 8, 0.14],
    ], np.float32,
)  # fmt: skip


def compose(splat_count: int, noise: NoiseField, rng: np.random.Generator) -> Surfels:
    """All surfels of the scene, unlit: `splat_count` of them, as moss takes what the other things leave.

    Few splats make a coarser scene with the same things in the same places.
    """
    terrain = Terrain(noise)
    seed = int(rng.integers(1 << 62))
    spacing = float(np.sqrt(AREA_COUNT / max(0.82 * splat_count - FIXED_COUNT, 0.3 * splat_count)))
    while True:
        things, ground, cover = _things(terrain, noise, spacing, np.random.default_rng(seed))
        if len(things) <= (1 - MOSS_SHARE) * splat_count:
            break
        spacing *= 1.05 * float(np.sqrt(len(things) / ((1 - MOSS_SHARE) * splat_count)))
    left = splat_count - len(things)
    moss = moss_fibres(ground, cover, left, noise, rng, 0.015 * spacing**0.5)
    return _in_spatial_order(join([things, moss]))


def _things(
    terrain: Terrain, noise: NoiseField, spacing: float, rng: np.random.Generator
) -> tuple[Surfels, Surfels, FloatArray]:
    """Everything but moss; then all that moss may grow on, and how mossy that is, (N,).

    Each thing has a random generator of its own, so that a change of one does not rearrange the others.
    """
    parts, ground, cover = _ground(terrain, noise, spacing, rng)
    for shape in MUSHROOMS:
        parts += mushroom(shape, terrain, noise, 0.0058 * spacing, rng.spawn(1)[0])
    x, y = (np.array([c], np.float32) for c in SNAIL)
    place = np.array([*SNAIL, terrain.height(x, y)[0] + 0.008], np.float32)
    heading = np.array([-0.9, -0.25, 0.0], np.float32)
    parts += snail(place, heading, terrain.normal(x, y)[0], 0.23, noise, 0.004 * spacing, rng.spawn(1)[0])
    parts += _plants(terrain, spacing, rng) + _litter(terrain, noise, spacing, rng)
    parts.append(sporophytes(ground, cover, round(150 / spacing), rng.spawn(1)[0]))
    return join(parts), ground, cover


def _ground(
    terrain: Terrain, noise: NoiseField, spacing: float, rng: np.random.Generator
) -> tuple[list[Surfels], Surfels, FloatArray]:
    """Floor, trunk, stones and branch; then all that moss may grow on as one, and how mossy that is, (N,)."""
    floor = forest_floor(terrain, noise, 0.0118 * spacing, rng.spawn(1)[0])
    parts = [floor]
    for make in (sawn_wood, trunk_bark):
        parts.append(make(terrain, noise, 0.0110 * spacing, rng.spawn(1)[0]))
    mossy = [(floor, terrain.moss(floor.position[:, 0], floor.position[:, 1]))]
    for stone in BOULDERS:
        mossy.append(boulder(stone, terrain, noise, 0.0088 * spacing, rng.spawn(1)[0]))
        parts.append(mossy[-1][0])
    wood, moss = branch(BRANCH, terrain, noise, 0.0050 * spacing, rng.spawn(1)[0])
    mossy.append((wood[0], moss))
    return parts + wood, join(made for made, _ in mossy), np.concatenate([moss for _, moss in mossy])


def _in_spatial_order(made: Surfels) -> Surfels:
    """The same surfels with neighbours next to each other in memory: depth maps and renderers run faster."""
    cell = ((made.position - made.position.min(axis=0)) / np.float32(0.04)).astype(np.int64)
    return made.where(np.argsort((cell[:, 0] << 20) + (cell[:, 1] << 10) + cell[:, 2], kind="stable"))


def _plants(terrain: Terrain, spacing: float, rng: np.random.Generator) -> list[Surfels]:
    parts = [fern((x, y), h, s, terrain, 0.0075 * spacing, rng.spawn(1)[0]) for x, y, h, s in FERNS]
    return [*parts, grass(terrain, TUFTS, max(4, round(13 / spacing)), rng.spawn(1)[0])]


def _litter(terrain: Terrain, noise: NoiseField, spacing: float, rng: np.random.Generator) -> list[Surfels]:
    parts = [needles(terrain, round(700 / spacing), rng.spawn(1)[0])]
    for x, y, size in LEADING_LEAVES:
        place = _on_floor(terrain, np.array([x], np.float32), np.array([y], np.float32))[0]
        parts.append(fallen_leaf(place, size, "maple", noise, 0.0068 * spacing, rng.spawn(1)[0]))
    for kind, count, size in (("maple", 9, 0.13), ("birch", 30, 0.07)):
        for place in _scattered(terrain, count, rng.spawn(1)[0]):
            own = rng.spawn(1)[0]
            parts.append(fallen_leaf(place, size * own.uniform(0.75, 1.2), kind, noise, 0.0068 * spacing, own))
    return parts


def _scattered(terrain: Terrain, count: int, rng: np.random.Generator) -> FloatArray:
    """Places on the floor, (count, 3), clear of stones and stems."""
    radius = 0.35 + 0.62 * np.sqrt(rng.random(4 * count))
    angle = rng.uniform(0, FULL_TURN, 4 * count)
    x, y = (radius * np.cos(angle)).astype(np.float32), (radius * np.sin(angle)).astype(np.float32)
    blocked = np.zeros(len(x), np.bool_)
    for stone in BOULDERS:
        blocked |= np.hypot(x - stone.x, y - stone.y) < max(stone.half_axes) + 0.09
    for shape in MUSHROOMS:
        blocked |= np.hypot(x - shape.x, y - shape.y) < 0.2
    free = np.flatnonzero(~blocked)[:count]
    return _on_floor(terrain, x[free], y[free])


def _on_floor(terrain: Terrain, x: FloatArray, y: FloatArray) -> FloatArray:
    """Places (N, 3) just above the tips of the moss."""
    return np.stack([x, y, terrain.height(x, y) + 0.024], axis=1)
