# SPDX-License-Identifier: GPL-3.0-or-later
"""A garden snail: a coiled, banded shell on a stretched foot with four feelers."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from .noise import FloatArray, NoiseField, smoothstep
from .surfels import Surfels, linear, mixed, normalised, strands, surface
from .terrain import FULL_TURN

Posing = Callable[[FloatArray], FloatArray]  # from the snail's own space to modelling space, (N, 3)

TURNS = 3.1
GROWTH = 0.52  # of the coil's radius per turn: each turn is 1 / 0.52 times the one inside it


def snail(
    place: FloatArray, forward: FloatArray, up: FloatArray, size: float, noise: NoiseField, spacing: float,
    rng: np.random.Generator,
) -> list[Surfels]:  # fmt: skip
    """A snail of about `size` [units] in length that sits at `place` (3,) and looks along `forward` (3,)."""
    forward = normalised(forward - up * float(forward @ up))
    axes = np.stack([forward, np.cross(up, forward), up]).astype(np.float32)

    def posed(points: FloatArray) -> FloatArray:
        return np.asarray(place + np.float32(size) * (points @ axes), np.float32)

    return [_shell(posed, noise, spacing, rng), _foot(posed, noise, spacing, rng), _feelers(posed)]


def _shell(posed: Posing, noise: NoiseField, spacing: float, rng: np.random.Generator) -> Surfels:
    def position_of(u: FloatArray, v: FloatArray) -> FloatArray:
        turn = (1 - u) * TURNS
        grown = np.power(GROWTH, turn)
        coil, around = turn * FULL_TURN - 1.9, v * FULL_TURN
        ribs = 1 + 0.012 * np.sin(turn * FULL_TURN * 26)
        tube = 0.155 * grown * ribs
        reach = 0.165 * grown + tube * np.cos(around)
        sideways = 0.16 * (1 - grown) * 0.9 - 0.02 + 1.12 * tube * np.sin(around)
        middle = np.array([-0.10, -0.05, 0.36], np.float32)
        points = np.stack([reach * np.cos(coil), sideways, reach * np.sin(coil)], axis=1)
        return posed((points + middle).astype(np.float32))

    made, grid = surface(position_of, spacing, rng)
    centre = made.position.mean(axis=0)
    inward = ((made.position - centre) * made.normal).sum(axis=1).mean() < 0
    made.normal *= np.float32(-1 if inward else 1)
    band = np.abs(((grid.v * 4 + 0.12) % 1) - 0.5)
    flecks = noise.fbm(np.stack([grid.u * 60, grid.v * 4, grid.u * 0], axis=1).astype(np.float32), 3)
    colour = mixed(linear("d9a65a"), linear("efcf93"), flecks)
    made.albedo = mixed(colour, linear("5a2f16"), smoothstep(0.24, 0.14, band + 0.25 * (flecks - 0.5)) * 0.9)
    made.gloss[:] = 0.7
    return made


def _foot(posed: Posing, noise: NoiseField, spacing: float, rng: np.random.Generator) -> Surfels:
    def position_of(u: FloatArray, v: FloatArray) -> FloatArray:
        angle = v * FULL_TURN
        width = 0.125 * np.sqrt(np.clip(np.sin(np.pi * np.clip(u, 0.004, 0.996)), 0, 1)) * (0.62 + 0.5 * u)
        neck = smoothstep(0.66, 1.0, u)
        bumps = 1 + 0.09 * (noise.fbm(np.stack([u * 34, np.cos(angle) * 5, np.sin(angle) * 5], 1), 2) - 0.5)
        lift = 0.06 + 0.22 * neck**1.5
        points = np.stack(
            [-0.52 + 1.08 * u, width * bumps * np.cos(angle), lift + width * bumps * np.sin(angle) * 0.8], 1
        )
        return posed(points.astype(np.float32))

    made, _ = surface(position_of, spacing, rng)
    speckle = noise.fbm(made.position * 260, 2)
    made.albedo = mixed(linear("94805e"), linear("d8c29c"), smoothstep(0.3, 0.7, speckle))
    made.gloss[:] = 0.6
    made.translucency[:] = 0.12
    return made


def _feelers(posed: Posing) -> Surfels:
    t = np.linspace(0, 1, 7, dtype=np.float32)
    lines = []
    for side, length, height in ((1, 0.24, 1.0), (-1, 0.24, 1.0), (1, 0.09, 0.1), (-1, 0.09, 0.1)):
        start = np.array([0.52, 0.035 * side, 0.28 + 0.04 * height], np.float32)
        way = np.array([0.55, 0.35 * side, 0.95 * height - 0.1], np.float32)
        lines.append(posed(start + way * (length * t)[:, None]))
    width = np.full((4, 6), 0.004, np.float32)
    width[:, -1] = 0.0065
    made, share = strands(np.stack(lines), width)
    made.albedo = mixed(linear("b39a76"), linear("4a3826"), smoothstep(0.8, 0.95, share))
    return made
