# SPDX-License-Identifier: GPL-3.0-or-later
"""A fallen branch with rough bark and broken ends."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .noise import FloatArray, NoiseField, smoothstep
from .surfels import Surfels, linear, mixed, normalised, surface
from .terrain import FULL_TURN, Terrain


@dataclass(frozen=True)
class Branch:
    """A fallen branch from `start` to `end` on the floor [units], with its radius and upward bow."""

    start: tuple[float, float]
    end: tuple[float, float]
    radius: float
    lift: float


class BranchCurve:
    """The branch's axis as a function of u in 0 … 1, and two directions across it."""

    def __init__(self, shape: Branch, terrain: Terrain) -> None:
        ends = np.array([shape.start, shape.end], np.float32)
        ground = terrain.height(ends[:, 0], ends[:, 1])
        self._start = np.array([*shape.start, ground[0] + 0.7 * shape.radius], np.float32)
        self._end = np.array([*shape.end, ground[1] + 0.7 * shape.radius], np.float32)
        self._lift = shape.lift
        self.side = normalised(np.cross(self._end - self._start, np.array([0, 0, 1], np.float32)))
        self.over = normalised(np.cross(self.side, self._end - self._start))
        self.along = normalised(self._end - self._start)

    def offset(self, radius: FloatArray, angle: FloatArray) -> FloatArray:
        """From the axis to the point at polar coordinates across it."""
        across = self.side * (radius * np.cos(angle))[:, None] + self.over * (radius * np.sin(angle))[:, None]
        return np.asarray(across, np.float32)

    def at(self, u: FloatArray) -> FloatArray:
        bow = np.sin(np.pi * u) * self._lift
        sway = 0.035 * np.sin(5.1 * u + 0.4)
        line = self._start + (self._end - self._start) * u[:, None]
        return np.asarray(line + self.over * bow[:, None] + self.side * sway[:, None], np.float32)


def branch(
    shape: Branch, terrain: Terrain, noise: NoiseField, spacing: float, rng: np.random.Generator
) -> tuple[list[Surfels], FloatArray]:
    """Bark and broken ends; and how mossy each piece of the bark is, (N,) in 0 … 1."""
    curve = BranchCurve(shape, terrain)

    def bark_depth(u: FloatArray, v: FloatArray) -> FloatArray:
        angle = v * FULL_TURN
        ring = np.stack([np.cos(angle) * 2.6, np.sin(angle) * 2.6, u * 6], axis=1).astype(np.float32)
        return smoothstep(0.35, 0.85, noise.ridged(ring, 3))

    def bark(u: FloatArray, v: FloatArray) -> FloatArray:
        knots = 0.22 * (noise.fbm(np.stack([np.cos(v * FULL_TURN), np.sin(v * FULL_TURN), u * 5], 1), 2) - 0.5)
        radius = shape.radius * (1.05 - 0.22 * u + knots - 0.24 * bark_depth(u, v))
        return curve.at(u) + curve.offset(radius.astype(np.float32), v * FULL_TURN)

    made, grid = surface(bark, 1.4 * spacing, rng, stretch=0.6)
    depth = bark_depth(grid.u, grid.v)
    made.albedo = mixed(linear("b39a78"), linear("45321f"), depth * (0.5 + 0.5 * noise.fbm(made.position * 40, 2)))
    lichen = smoothstep(0.60, 0.66, noise.fbm(made.position * 12 + 3, 3)) * (1 - depth)
    made.albedo = mixed(made.albedo, linear("aab48f"), 0.8 * lichen)
    moss = 0.5 * smoothstep(0.6, 0.8, made.normal[:, 2] * 0.8 + 1.2 * (noise.fbm(made.position * 6 + 9, 3) - 0.5))
    made.albedo = mixed(made.albedo, linear("3a4a16"), 0.9 * moss)
    ends = [_broken_end(curve, shape, noise, spacing, rng, at_end) for at_end in (False, True)]
    return [made, *ends], moss


def _broken_end(
    curve: BranchCurve, shape: Branch, noise: NoiseField, spacing: float, rng: np.random.Generator, at_end: bool
) -> Surfels:
    """Splintered wood that closes the branch at its start or end."""
    place = np.float32(1.0 if at_end else 0.0)
    radius = shape.radius * (0.80 if at_end else 1.0) * 0.93

    def wood(u: FloatArray, v: FloatArray) -> FloatArray:
        splinters = 0.16 * radius * (noise.fbm(curve.offset(u, v * FULL_TURN) * 9 + 3, 3) - 0.35)
        outward = curve.along * (1 if at_end else -1)
        middle = curve.at(np.full_like(u, place))
        return np.asarray(middle + curve.offset(u * radius, v * FULL_TURN) + outward * splinters[:, None], np.float32)

    made, grid = surface(wood, spacing * 0.8, rng, flipped=at_end)
    rings = (0.5 + 0.5 * np.sin(grid.u * 30 + 2.5 * noise(made.position * 20))).astype(np.float32)
    made.albedo = mixed(linear("d9b47e"), linear("9a6b3c"), rings)
    made.albedo = mixed(made.albedo, linear("5a3d25"), smoothstep(0.9, 0.97, grid.u))
    return made
