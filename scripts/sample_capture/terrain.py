# SPDX-License-Identifier: GPL-3.0-or-later
"""The base of the still life: a slice of a tree trunk with a piece of forest floor on it."""

from __future__ import annotations

import numpy as np

from .noise import FloatArray, NoiseField, smoothstep
from .surfels import Surfels, linear, mixed, surface

TRUNK_RADIUS = 1.16
TRUNK_HEIGHT = 0.13
FULL_TURN = np.float32(2 * np.pi)


class Terrain:
    """Height, moss cover and outline of the forest floor; everything that stands on it asks here."""

    def __init__(self, noise: NoiseField) -> None:
        self._noise = noise

    def trunk_radius(self, angle: FloatArray) -> FloatArray:
        """Outline of the wooden slice [units] at `angle` [rad]."""
        ring = np.stack([np.cos(angle), np.sin(angle), np.zeros_like(angle)], axis=1)
        return np.asarray(TRUNK_RADIUS * (1 + 0.10 * (self._noise(ring * 1.3 + 5) - 0.5)), np.float32)

    def floor_radius(self, angle: FloatArray) -> FloatArray:
        """Outline of moss and soil [units] at `angle` [rad]."""
        ring = np.stack([np.cos(angle), np.sin(angle), np.zeros_like(angle)], axis=1)
        ragged = 0.10 * (self._noise.fbm(ring * 2.3 + 31, 2) - 0.5) + 0.05 * (self._noise(ring * 14 + 3) - 0.5)
        return np.asarray(self.trunk_radius(angle) - 0.10 + ragged, np.float32)

    def height(self, x: FloatArray, y: FloatArray) -> FloatArray:
        """Height of the floor above the table [units], with its hummocks and moss cushions."""
        flat = np.stack([x, y, np.zeros_like(x)], axis=1)
        share = np.hypot(x, y) / self.floor_radius(np.arctan2(y, x))
        swell = smoothstep(1.0, 0.72, share)
        hummocks = 0.17 * (self._noise.fbm(flat * 2.1 + 7, 2) - 0.5)
        cushions = 0.06 * self.moss(x, y) * smoothstep(0.1, 0.8, self._noise(flat * 10 + 13))
        clods = 0.016 * self._noise.fbm(flat * 24, 2)
        lift = 0.035 + 0.10 * np.clip(1 - share * share, 0, 1) + hummocks + cushions + clods
        return np.asarray(TRUNK_HEIGHT - 0.012 + swell * np.maximum(lift, 0.01), np.float32)

    def moss(self, x: FloatArray, y: FloatArray) -> FloatArray:
        """How much of the floor is moss, 0 … 1, (N,)."""
        flat = np.stack([x, y, np.zeros_like(x)], axis=1)
        bare = self._noise.fbm(flat * 2.4 + 41, 3)
        rim = smoothstep(0.6, 0.95, np.hypot(x, y) / TRUNK_RADIUS)
        return smoothstep(0.47, 0.56, bare + 0.10 * rim)

    def normal(self, x: FloatArray, y: FloatArray) -> FloatArray:
        """Upward unit normal of the floor, (N, 3)."""
        step = np.float32(0.012)
        slope_x = (self.height(x + step, y) - self.height(x - step, y)) / (2 * step)
        slope_y = (self.height(x, y + step) - self.height(x, y - step)) / (2 * step)
        normal = np.stack([-slope_x, -slope_y, np.ones_like(x)], axis=1)
        return np.asarray(normal / np.linalg.norm(normal, axis=1, keepdims=True), np.float32)


def forest_floor(terrain: Terrain, noise: NoiseField, spacing: float, rng: np.random.Generator) -> Surfels:
    """Soil, with the dark underlay of moss where moss grows."""

    def position_of(u: FloatArray, v: FloatArray) -> FloatArray:
        angle = v * FULL_TURN
        radius = u * terrain.floor_radius(angle)
        x, y = radius * np.cos(angle), radius * np.sin(angle)
        return np.stack([x, y, terrain.height(x, y)], axis=1)

    made, _ = surface(position_of, spacing, rng)
    x, y, _z = made.position.T
    crumbs = noise.fbm(made.position * 45, 3)
    soil = mixed(linear("2c1f16"), linear("6b4a30"), smoothstep(0.3, 0.75, crumbs))
    soil = mixed(soil, linear("8a6a48"), 0.8 * smoothstep(0.68, 0.8, noise(made.position * 90)))
    made.albedo = mixed(soil, linear("4a5c18"), terrain.moss(x, y) * 0.9)
    return made


def sawn_wood(terrain: Terrain, noise: NoiseField, spacing: float, rng: np.random.Generator) -> Surfels:
    """The visible border of the trunk's sawn top: growth rings, drying cracks, the dark line under the bark."""

    def position_of(u: FloatArray, v: FloatArray) -> FloatArray:
        angle = v * FULL_TURN
        inner, outer = terrain.floor_radius(angle) - 0.02, terrain.trunk_radius(angle)
        radius = inner + (outer - inner) * u
        rounding = 0.02 * smoothstep(0.86, 1.0, u) ** 2
        return np.stack([radius * np.cos(angle), radius * np.sin(angle), TRUNK_HEIGHT - rounding], axis=1)

    made, _ = surface(position_of, spacing * 0.52, rng, stretch=2.6)
    angle = np.arctan2(made.position[:, 1], made.position[:, 0])
    depth = np.hypot(made.position[:, 0], made.position[:, 1]) / terrain.trunk_radius(angle)
    wobble = 0.012 * noise(made.position * 5)
    rings = 0.5 + 0.5 * np.sin((depth + wobble) * 330 + 5 * np.sin(depth * 40))
    grain = mixed(linear("c9a06c"), linear("85552a"), smoothstep(0.45, 1.0, rings))
    grain = mixed(grain, linear("8a6238"), 0.4 * smoothstep(0.5, 0.75, noise.fbm(made.position * 7, 3)))
    wood = mixed(grain, linear("4a2f1c"), smoothstep(0.972, 0.98, depth))
    winding = angle + 0.02 * noise(made.position * 30)
    to_crack = np.abs(winding[:, None] - rng.uniform(-np.pi, np.pi, 13)).min(axis=1) * depth
    cracks = smoothstep(0.0065, 0.002, to_crack) * smoothstep(0.86, 0.93, depth)
    made.albedo = mixed(wood, linear("3a2616"), cracks)
    made.gloss[:] = 0.12
    return made


def trunk_bark(terrain: Terrain, noise: NoiseField, spacing: float, rng: np.random.Generator) -> Surfels:
    """The bark around the trunk: plates between furrows, with a little lichen."""

    def relief(u: FloatArray, v: FloatArray) -> tuple[FloatArray, FloatArray]:
        angle = v * FULL_TURN
        ring = np.stack([np.cos(angle) * 10, np.sin(angle) * 10, u * 0.9], axis=1).astype(np.float32)
        flakes = noise.fbm(ring * np.array([1.7, 1.7, 3.0], np.float32), 3)
        warped = ring + 0.5 * flakes[:, None]
        return smoothstep(0.68, 1.0, 1 - np.abs(2 * noise(warped) - 1)), flakes

    def position_of(u: FloatArray, v: FloatArray) -> FloatArray:
        angle = v * FULL_TURN
        furrows, flakes = relief(u, v)
        radius = terrain.trunk_radius(angle) - smoothstep(0.0, 0.2, u) * (0.013 * furrows + 0.006 * flakes)
        return np.stack([radius * np.cos(angle), radius * np.sin(angle), (TRUNK_HEIGHT - 0.012) * u], axis=1)

    made, grid = surface(position_of, spacing * 0.75, rng, stretch=0.8, flipped=True)
    furrows, flakes = relief(grid.u, grid.v)
    weathering = 1 - flakes + 0.5 * (noise.fbm(made.position * 40, 2) - 0.5)
    plates = mixed(linear("54402f"), linear("b09a7e"), smoothstep(0.25, 0.8, weathering))
    bark = mixed(plates, linear("3d2b1f"), furrows)
    lichen = smoothstep(0.6, 0.68, noise.fbm(made.position * 14 + 3, 3)) * (1 - furrows)
    made.albedo = mixed(bark, linear("8f9a72"), 0.5 * lichen)
    return made
