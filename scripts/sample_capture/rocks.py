# SPDX-License-Identifier: GPL-3.0-or-later
"""Boulders and pebbles."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .noise import FloatArray, NoiseField, smoothstep
from .surfels import Surfels, linear, mixed, normalised, surface
from .terrain import FULL_TURN, Terrain


@dataclass(frozen=True)
class Boulder:
    """A stone: its place, half-axes [units], how much moss it carries (0 … 1) and its colour."""

    x: float
    y: float
    half_axes: tuple[float, float, float]
    sunk: float
    moss: float
    colour: str = "807b74"
    detail: float = 1.0


def boulder(
    shape: Boulder, terrain: Terrain, noise: NoiseField, spacing: float, rng: np.random.Generator
) -> tuple[Surfels, FloatArray]:
    """The stone and how mossy each piece of it is, (N,) in 0 … 1."""
    facets = normalised(rng.normal(size=(11, 3)).astype(np.float32))
    distance = rng.uniform(0.66, 0.98, 11).astype(np.float32)
    bedding = normalised(np.array([0.3, 0.2, 1], np.float32))
    axes = np.array(shape.half_axes, np.float32)
    ground = terrain.height(np.array([shape.x], np.float32), np.array([shape.y], np.float32))[0]
    centre = np.array([shape.x, shape.y, ground + axes[2] * (1 - shape.sunk)], np.float32)
    coarse = np.float32(1.1 / axes.mean())

    def position_of(u: FloatArray, v: FloatArray) -> FloatArray:
        polar, angle = u * np.float32(0.86 * np.pi), v * FULL_TURN
        way = np.stack([np.sin(polar) * np.cos(angle), np.sin(polar) * np.sin(angle), np.cos(polar)], axis=1)
        way = way.astype(np.float32)
        reach = distance / np.maximum(way @ facets.T, 0.05)
        radius = -np.log(np.exp(-20 * np.minimum(reach, 2.0)).sum(axis=1) + np.exp(-20 * 1.02)) / 20
        point = way * axes * radius[:, None]
        rough = 0.16 * (noise.fbm(point * coarse + centre * 3, 2) - 0.5)
        layers = np.stack([point @ bedding * 26, point[:, 0] * 3, point[:, 1] * 3], axis=1) + rough[:, None] * 9
        grain = 0.055 * (noise.fbm(layers, 3) - 0.5) + 0.03 * (noise.fbm(point * 30, 3) - 0.5)
        return np.asarray(centre + point * (1 + rough + grain)[:, None], np.float32)

    made, _ = surface(position_of, spacing * shape.detail, rng)
    up = made.normal[:, 2] + 1.1 * (noise.fbm(made.position * 4.2, 3) - 0.5)
    moss = shape.moss * smoothstep(0.38, 0.62, up.astype(np.float32))
    made.albedo = _stone_colour(made, noise, shape)
    made.albedo = mixed(made.albedo, linear("3a4a16"), moss * 0.95)
    made.gloss[:] = 0.10
    return made, moss


def _stone_colour(made: Surfels, noise: NoiseField, shape: Boulder) -> FloatArray:
    base = linear(shape.colour)
    spots = noise.fbm(made.position * 28, 4)
    colour = mixed(base * 0.6, base * 1.35, smoothstep(0.25, 0.75, spots))
    colour = mixed(colour, linear("a5855f"), 0.35 * smoothstep(0.5, 0.7, noise.fbm(made.position * 5 + 2, 3)))
    cracks = smoothstep(0.80, 0.95, noise.ridged(made.position * 7 + 5, 3))
    colour = mixed(colour, linear("3f3a36"), 0.35 * cracks)
    crystals = smoothstep(0.80, 0.88, noise(made.position * 75))
    colour = mixed(colour, linear("d8d4c8"), 0.5 * crystals)
    lichen = smoothstep(0.62, 0.66, noise.fbm(made.position * 8.5 + 11, 4)) * smoothstep(-0.2, 0.3, made.normal[:, 2])
    colour = mixed(colour, linear("a9b394"), 0.75 * lichen)
    orange = smoothstep(0.685, 0.71, noise.fbm(made.position * 10 + 29, 4))
    return mixed(colour, linear("c98a2b"), 0.8 * orange)
