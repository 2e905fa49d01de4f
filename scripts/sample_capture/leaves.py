# SPDX-License-Identifier: GPL-3.0-or-later
"""What has fallen to the floor: leaves of maple and birch, pine needles."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from .noise import FloatArray, NoiseField, smoothstep
from .surfels import UP, Surfels, join, linear, mixed, normalised, strands, surface
from .terrain import FULL_TURN, TRUNK_RADIUS, Terrain

MAPLE_LOBES = ((0.0, 1.0, 0.27), (0.95, 0.90, 0.25), (-0.95, 0.90, 0.25), (1.95, 0.60, 0.28), (-1.95, 0.60, 0.28))


def maple_outline(angle: FloatArray) -> FloatArray:
    """Radius of a maple leaf with unit middle lobe at `angle` [rad] from that lobe; toothed."""
    turn = (angle + np.pi) % (2 * np.pi) - np.pi
    radius = 0.36 * np.ones_like(turn)
    for centre, reach, width in MAPLE_LOBES:
        off = np.abs(turn - centre) / width
        lobe = reach * np.exp(-np.power(off, 1.25) * 0.75)
        teeth = 1 + 0.13 * np.cos(off * 7.5) * (off < 1.7)
        radius = np.maximum(radius, lobe * teeth)
    return np.asarray(radius * smoothstep(3.14, 2.75, np.abs(turn)) + 0.03, np.float32)


def birch_outline(angle: FloatArray) -> FloatArray:
    """Radius of a pointed oval leaf, finely toothed, at `angle` [rad] from its tip."""
    turn = np.abs((angle + np.pi) % (2 * np.pi) - np.pi)
    oval = 0.52 + 0.48 * np.exp(-np.power(turn / 0.42, 1.1)) - 0.06 * np.cos(2 * turn)
    return np.asarray(oval * (1 + 0.035 * np.cos(turn * 34)) * smoothstep(3.5, 2.9, turn), np.float32)


LEAF_COLOURS = (
    ("c8671a", "e8a02c"), ("d9a21f", "ecc94e"), ("a83a14", "d8651c"), ("8a5a2c", "b9824a"), ("cf941c", "efcb55"),
    ("b98a2a", "a8a83a"),
)  # fmt: skip


def fallen_leaf(
    place: FloatArray, size: float, kind: str, noise: NoiseField, spacing: float, rng: np.random.Generator
) -> Surfels:
    """A curled leaf whose middle lies at `place` (3,) [units], with veins and a stalk."""
    outline = maple_outline if kind == "maple" else birch_outline
    tilt = normalised(UP + rng.normal(0, 0.16, 3).astype(np.float32))
    first = normalised(np.cross(tilt, rng.normal(size=3).astype(np.float32)))
    second = np.cross(tilt, first)
    curl, fold, seed = rng.uniform(-0.1, 0.4), rng.uniform(0.0, 0.3), np.float32(rng.uniform(0, 50))

    def position_of(u: FloatArray, v: FloatArray) -> FloatArray:
        angle = v * FULL_TURN
        radius = u * outline(angle)
        a, b = radius * np.cos(angle), radius * np.sin(angle)
        bumps = 0.18 * (noise(np.stack([a * 2.6, b * 2.6, a * 0], 1) + seed) - 0.5) * (0.3 + u)
        lift = curl * radius * radius * 0.5 + fold * np.abs(b) * 0.45 + bumps + 0.06
        return np.asarray(place + size * (first * a[:, None] + second * b[:, None] + tilt * lift[:, None]), np.float32)

    made, grid = surface(position_of, spacing, rng, closed=False)
    made.albedo = _leaf_colour(made, grid.u, grid.v * FULL_TURN, outline, noise, rng)
    made.translucency[:] = 0.38
    made.gloss[:] = 0.28
    t = np.linspace(0, 0.75, 9, dtype=np.float32)
    stem_line = place + size * (first * -t[:, None] + tilt * (0.06 + 0.35 * t**2)[:, None])
    stem, _ = strands(stem_line[None].astype(np.float32), np.full((1, 8), 0.028 * size + 0.001, np.float32))
    stem.albedo[:] = linear("8a3f1c")
    return join([made, stem])


def _leaf_colour(
    made: Surfels,
    u: FloatArray,
    angle: FloatArray,
    outline: Callable[[FloatArray], FloatArray],
    noise: NoiseField,
    rng: np.random.Generator,
) -> FloatArray:
    """Albedo (N, 3): two autumn tones, brown edges, rust spots and pale veins; `u` and `angle` are the leaf's own."""
    inner, outer = (linear(code) for code in LEAF_COLOURS[rng.integers(len(LEAF_COLOURS))])
    blotches = noise.fbm(made.position * 22, 3)
    colour = mixed(inner, outer, smoothstep(0.3, 0.7, blotches))
    colour = mixed(colour, linear("6e3315"), 0.7 * smoothstep(0.75, 1.05, u + 0.5 * (blotches - 0.5)))
    colour = mixed(colour, linear("4a2a14"), 0.8 * smoothstep(0.67, 0.72, noise.fbm(made.position * 50, 2)))
    radius = u * outline(angle)
    vein = _veins(radius * np.cos(angle), radius * np.sin(angle), outline is maple_outline)
    return mixed(colour, colour * 0.3 + linear("e9c889") * 0.55, 0.75 * vein)


def _veins(a: FloatArray, b: FloatArray, in_lobes: bool) -> FloatArray:
    """Where the veins run, (N,) in 0 … 1: one into each lobe, or pairs that leave the midrib."""
    vein = smoothstep(0.03, 0.012, np.abs(b)) * (a > -0.1)
    if in_lobes:
        for centre, _reach, _width in MAPLE_LOBES[1:]:
            off = np.abs(a * np.sin(centre) - b * np.cos(centre))
            ahead = a * np.cos(centre) + b * np.sin(centre) > 0
            vein = np.maximum(vein, smoothstep(0.028, 0.01, off) * ahead)
    else:
        side = np.abs(((a - 0.8 * np.abs(b)) * 7) % 1 - 0.5)
        vein = np.maximum(vein, 0.6 * smoothstep(0.14, 0.05, side))
    return np.asarray(vein, np.float32)


def needles(terrain: Terrain, count: int, rng: np.random.Generator) -> Surfels:
    """Fallen pine needles, mostly on bare soil; each a thread of two splats."""
    radius, angle = TRUNK_RADIUS * 0.85 * np.sqrt(rng.random(4 * count)), rng.uniform(0, FULL_TURN, 4 * count)
    x, y = (radius * np.cos(angle)).astype(np.float32), (radius * np.sin(angle)).astype(np.float32)
    keep = np.flatnonzero(rng.random(len(x)) > 0.93 * terrain.moss(x, y))[:count]
    x, y, turn = x[keep], y[keep], rng.uniform(0, FULL_TURN, len(keep))
    half = rng.uniform(0.022, 0.045, len(keep))
    step = (np.stack([np.cos(turn), np.sin(turn)], axis=1) * half[:, None]).astype(np.float32)
    height = terrain.height(x, y) + rng.uniform(0.004, 0.012, len(x)).astype(np.float32)
    tip = rng.normal(0, 0.007, (2, len(x))).astype(np.float32)
    points = [np.stack([x + s * step[:, 0], y + s * step[:, 1], height + lift], axis=1) for s, lift in
              ((-1, tip[0]), (0, np.float32(0.004)), (1, tip[1]))]  # fmt: skip
    made, _ = strands(np.stack(points, axis=1).astype(np.float32), np.full((len(x), 2), 0.0030, np.float32))
    tone = np.repeat(rng.random(len(x)).astype(np.float32), 2)
    made.albedo = mixed(linear("7a4a22"), linear("d09a58"), tone)
    return made
