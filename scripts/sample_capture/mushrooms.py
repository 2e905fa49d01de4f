# SPDX-License-Identifier: GPL-3.0-or-later
"""Fly agarics: red caps with white warts, gills, a skirt around the stem."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from .noise import FloatArray, NoiseField, smoothstep
from .surfels import Surfels, linear, mixed, normalised, surface
from .terrain import FULL_TURN, Terrain

RIM_ANGLE = 1.84  # [rad] from the cap's apex to its rim: a little beyond the widest place
GILL_COUNT = 110


@dataclass(frozen=True)
class Mushroom:
    """Where a mushroom stands and how it has grown [units]; `dome` is the cap's height over its radius."""

    x: float
    y: float
    height: float
    cap_radius: float
    dome: float
    lean: tuple[float, float]
    wart_count: int
    detail: float = 1.0


class Posed:
    """Bends an upright mushroom: the stem leans as a parabola, the cap tilts with its end."""

    def __init__(self, shape: Mushroom, ground: float) -> None:
        self._shape = shape
        self._origin = np.array([shape.x, shape.y, ground - 0.02], np.float32)
        self._lean = np.array([*shape.lean, 0], np.float32)
        tilt = normalised(np.array([1.3 * shape.lean[0], 1.3 * shape.lean[1], shape.height], np.float32))
        x_axis = normalised(np.cross(np.array([0, 1, 0], np.float32), tilt))
        self._cap_axes = np.stack([x_axis, np.cross(tilt, x_axis), tilt])

    def stem(self, points: FloatArray) -> FloatArray:
        share = np.clip(points[:, 2:] / self._shape.height, 0, 1.2)
        return np.asarray(self._origin + points + self._lean * share * share, np.float32)

    def cap(self, points: FloatArray) -> FloatArray:
        """`points` are relative to the top of the stem."""
        top = self._origin + self._lean + np.array([0, 0, self._shape.height], np.float32)
        return np.asarray(top + points @ self._cap_axes, np.float32)


def on_circle(radius: FloatArray, v: FloatArray, height: FloatArray) -> FloatArray:
    angle = v * FULL_TURN
    return np.stack([radius * np.cos(angle), radius * np.sin(angle), height], axis=1).astype(np.float32)


def mushroom(
    shape: Mushroom, terrain: Terrain, noise: NoiseField, spacing: float, rng: np.random.Generator
) -> list[Surfels]:
    """All parts of one mushroom, rooted in the floor."""
    at = np.array([shape.x], np.float32), np.array([shape.y], np.float32)
    posed = Posed(shape, float(terrain.height(*at)[0]))
    fine = spacing * shape.detail
    parts = [_cap(shape, posed, noise, fine, rng), _gills(shape, posed, noise, fine, rng)]
    parts.append(_stem(shape, posed, noise, fine * 1.2, rng))
    if shape.height > 1.6 * shape.cap_radius:
        parts.append(_skirt(shape, posed, noise, fine, rng))
    return parts


def _wart_mask(
    shape: Mushroom, noise: NoiseField, rng: np.random.Generator
) -> Callable[[FloatArray], tuple[FloatArray, FloatArray]]:
    """A function of points on the undisplaced cap: how surely a wart is there, and its height [units]."""
    k = np.arange(shape.wart_count) + 0.5
    polar = np.arccos(1 - 1.05 * k / shape.wart_count) + rng.normal(0, 0.035, shape.wart_count)
    azimuth = k * 2.39996 + rng.normal(0, 0.10, shape.wart_count)
    r = shape.cap_radius
    centre = np.stack(
        [r * np.sin(polar) * np.cos(azimuth), r * np.sin(polar) * np.sin(azimuth), r * shape.dome * np.cos(polar)],
        axis=1,
    ).astype(np.float32)
    size = (rng.uniform(0.42, 1.0, shape.wart_count) ** 1.2 * r * 0.115).astype(np.float32)

    def mask_and_height(points: FloatArray) -> tuple[FloatArray, FloatArray]:
        square = (points * points).sum(1)[:, None] + (centre * centre).sum(1) - 2 * points @ centre.T
        reach = np.sqrt(np.maximum(square, 0)) / size
        nearest = reach.argmin(axis=1)
        rough = noise.fbm(np.asarray(points * (9 / r), np.float32), 3) - 0.5
        distance = reach[np.arange(len(points)), nearest] + 1.1 * rough
        height = smoothstep(1.05, 0.45, distance) * size[nearest] * (0.42 + 0.5 * rough)
        return smoothstep(1.02, 0.92, distance), np.asarray(height, np.float32)

    return mask_and_height


def _cap(shape: Mushroom, posed: Posed, noise: NoiseField, spacing: float, rng: np.random.Generator) -> Surfels:
    warts = _wart_mask(shape, noise, rng)
    r = shape.cap_radius

    def bare(u: FloatArray, v: FloatArray) -> FloatArray:
        polar = u * RIM_ANGLE
        waviness = 1 + 0.05 * (noise(on_circle(np.full_like(v, 1.4), v, u) + shape.height * 31) - 0.5) * u
        return on_circle(r * np.sin(polar) * waviness, v, r * shape.dome * np.cos(polar))

    def displaced(u: FloatArray, v: FloatArray) -> FloatArray:
        points = bare(u, v)
        outward = normalised(points * np.array([1, 1, 1 / shape.dome**2], np.float32))
        dents = 0.02 * r * (noise.fbm(points * np.float32(3 / r), 2) - 0.5)
        return posed.cap(points + outward * (warts(points)[1] + dents)[:, None])

    made, grid = surface(displaced, spacing, rng)
    local = bare(grid.u, grid.v)
    mask, height = warts(local)
    streaks = noise.fbm(on_circle(np.full_like(grid.v, 14.0), grid.v, grid.u * 2), 3)
    red = mixed(linear("8e0a08"), linear("cf1f0c"), smoothstep(0.0, 0.85, grid.u + 0.5 * (streaks - 0.5)))
    red = mixed(red, linear("ef7a22"), 0.75 * smoothstep(0.88, 1.04, grid.u + 0.22 * (streaks - 0.5)))
    red *= 0.85 + 0.3 * noise.fbm(local * np.float32(8 / r), 3)[:, None]
    wart = mixed(linear("c9ad7c"), linear("efe6d2"), smoothstep(0.0, 0.03 * r, height))
    made.albedo = mixed(red, wart, mask)
    made.gloss = (0.85 * (1 - mask) + 0.05).astype(np.float32)
    made.translucency[:] = 0.06
    return made


def _gills(shape: Mushroom, posed: Posed, noise: NoiseField, spacing: float, rng: np.random.Generator) -> Surfels:
    r, rim_height = shape.cap_radius, shape.cap_radius * shape.dome * np.cos(RIM_ANGLE)

    def position_of(u: FloatArray, v: FloatArray) -> FloatArray:
        radius = r * (np.sin(RIM_ANGLE) * 0.975 - 0.82 * u)
        hollow = 0.34 * r * np.sin(np.pi * np.clip(0.5 * u + 0.02, 0, 1)) ** 0.8
        pleats = 0.012 * r * np.cos(v * FULL_TURN * GILL_COUNT)
        return posed.cap(on_circle(radius, v, rim_height + hollow + pleats * np.clip(8 * u, 0, 1)))

    made, grid = surface(position_of, spacing * 2.0, rng, stretch=0.42)
    made.normal = _downward(made.normal)
    lamella = 0.5 - 0.5 * np.cos(grid.v * FULL_TURN * GILL_COUNT)
    made.albedo = mixed(linear("b99f78"), linear("f6ead0"), smoothstep(0.15, 0.8, lamella.astype(np.float32)))
    made.translucency[:] = 0.12
    return made


def _downward(normal: FloatArray) -> FloatArray:
    return np.asarray(np.where(normal[:, 2:] > 0, -normal, normal), np.float32)


def _stem(shape: Mushroom, posed: Posed, noise: NoiseField, spacing: float, rng: np.random.Generator) -> Surfels:
    thick = 0.055 + 0.10 * shape.cap_radius

    def position_of(u: FloatArray, v: FloatArray) -> FloatArray:
        height = u * shape.height * 1.04
        bulb = 0.62 * np.exp(-np.square(u * shape.height / 0.075))
        volva = 0.03 * np.sin(u * shape.height * 210) * smoothstep(0.15, 0.06, u * shape.height)
        ring = on_circle(np.full_like(v, 2.2), v, u * 3)
        ribs = 0.05 * (noise.fbm(on_circle(np.full_like(v, 9.0), v, u * 1.5), 2) - 0.5)
        radius = thick * (1.06 - 0.34 * u + bulb + volva * (1.6 * noise(ring * 3)) + ribs)
        return posed.stem(on_circle(radius, v, height))

    made, grid = surface(position_of, 1.25 * spacing, rng, flipped=True, stretch=0.65)
    fibres = noise.fbm(on_circle(np.full_like(grid.v, 11.0), grid.v, grid.u * 3), 3)
    colour = mixed(linear("e2d3b2"), linear("faf3e2"), smoothstep(0.25, 0.6, fibres))
    stain = smoothstep(0.16, 0.0, grid.u * shape.height) * (0.3 + 0.7 * noise.fbm(made.position * 25, 2))
    made.albedo = mixed(colour, linear("7a5d3c"), 0.8 * stain)
    made.gloss[:] = 0.08
    made.translucency[:] = 0.06
    return made


def _skirt(shape: Mushroom, posed: Posed, noise: NoiseField, spacing: float, rng: np.random.Generator) -> Surfels:
    thick, level = 0.055 + 0.10 * shape.cap_radius, 0.74 * shape.height

    def position_of(u: FloatArray, v: FloatArray) -> FloatArray:
        ruffle = noise.fbm(on_circle(np.full_like(v, 2.1), v, u * 0.4), 2) - 0.5
        folds = 0.05 * np.sin(v * FULL_TURN * 7 + 9 * ruffle) * u
        radius = thick * (0.70 + 0.62 * np.power(np.clip(u, 0, 2), 0.7) + 0.9 * ruffle * u + folds)
        drop = thick * (1.3 * u**1.5 + 1.3 * ruffle * u + 0.6 * folds)
        return posed.stem(on_circle(radius, v, level - drop))

    made, grid = surface(position_of, spacing * 0.9, rng)
    stripes = 0.5 + 0.5 * np.cos(grid.v * FULL_TURN * 60)
    made.albedo = mixed(linear("fbf3de"), linear("d9c69c"), (0.5 * stripes * grid.u).astype(np.float32))
    made.albedo = mixed(made.albedo, linear("c98f3c"), 0.5 * smoothstep(0.9, 1.0, grid.u))
    made.translucency[:] = 0.2
    return made
