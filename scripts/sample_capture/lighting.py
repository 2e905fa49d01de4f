# SPDX-License-Identifier: GPL-3.0-or-later
"""Sunlight, skylight, shadows and one bounce of indirect light, for surfels lit by each other.

Visibility comes from depth maps: seen from a direction, a surfel is lit if nothing lies before it. Many
directions around the sun give soft shadows, many over the sky give ambient occlusion, and every thin blade takes
part as an occluder. Radiance is in units in which white paper in the sun is about 2.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .noise import FloatArray, NoiseField, smoothstep
from .surfels import Surfels, linear, normalised

SUN_DIRECTION = normalised(np.array([-0.80, -0.22, 0.62], np.float32))  # towards the sun, modelling space
LIT_MIDDLE = np.array([0.02, -0.08, 0.55], np.float32)  # where the trees leave a gap
SUN_RADIANCE = 5.6 * np.array([1.0, 0.83, 0.60], np.float32)
SKY_ZENITH = 1.25 * np.array([0.60, 0.78, 1.0], np.float32)
SKY_HORIZON = 0.8 * np.array([0.80, 0.86, 0.84], np.float32)
SUN_SAMPLES, SUN_SPREAD, SUN_CELL = 16, 0.035, 0.0065  # count, angular radius [rad], depth-map cell [units]
SKY_SAMPLES, SKY_CELL = 56, 0.013
BOUNCE_CELLS, BOUNCE_CELL = 40, 0.07


@dataclass
class Light:
    """What arrives at each surfel, scene-linear.

    - `diffuse` (N, 3): radiance that leaves it in every direction.
    - `sun` (N,): how much of the sun it sees, 0 … 1.
    - `open_sky` (N,): how much of its sky is open, 0 … 1.
    """

    diffuse: FloatArray
    sun: FloatArray
    open_sky: FloatArray


def sky_radiance(up: FloatArray) -> FloatArray:
    """Radiance of the sky, or of the dim surroundings below the horizon, (…, 3), by the direction's height (…)."""
    sky = SKY_HORIZON + (SKY_ZENITH - SKY_HORIZON) * np.sqrt(np.clip(up, 0, 1))[..., None]
    below = 0.16 * np.array([0.85, 0.9, 0.7], np.float32)
    return np.asarray(below + (sky - below) * smoothstep(-0.15, 0.12, up)[..., None], np.float32)


def visibility(
    position: FloatArray, direction: FloatArray, cell: float, bias: float, rng: np.random.Generator
) -> FloatArray:
    """How freely light from `direction` (3,) reaches each position, (N,) in 0 … 1; occluders are `cell` wide."""
    side = normalised(np.cross(direction, np.array([0.3, 0.5, 0.81], np.float32)))
    axes = np.stack([side, np.cross(direction, side), direction]).astype(np.float32)
    local = position @ axes.T
    pixel = ((local[:, :2] - local[:, :2].min(axis=0)) / np.float32(cell) + rng.random(2, dtype=np.float32)).astype(
        np.int32
    )
    width = int(pixel[:, 0].max()) + 2
    index = pixel[:, 1] * width + pixel[:, 0]
    depth = np.full(width * (int(pixel[:, 1].max()) + 2), -np.inf, np.float32)
    np.maximum.at(depth, index, local[:, 2])
    grid = depth.reshape(-1, width)
    closed = grid.copy()  # neighbouring cells close the gaps between splats
    closed[:, 1:] = np.maximum(closed[:, 1:], grid[:, :-1])
    closed[1:] = np.maximum(closed[1:], closed[:-1].copy())
    gap = closed.ravel()[index] - local[:, 2]
    return np.clip(1.5 - gap / np.float32(bias), 0, 1)


def _around(direction: FloatArray, spread: float, count: int) -> FloatArray:
    """`count` unit vectors in a cone of `spread` [rad] around `direction`, evenly over its disc."""
    k = np.arange(count)
    radius, angle = spread * np.sqrt((k + 0.5) / count), 2.39996 * k
    side = normalised(np.cross(direction, np.array([0, 1, 0], np.float32)))
    over = np.cross(direction, side)
    disc = side * (radius * np.cos(angle))[:, None] + over * (radius * np.sin(angle))[:, None]
    return normalised((direction + disc).astype(np.float32))


def _sky_directions(count: int) -> FloatArray:
    k = np.arange(count)
    up, angle = 0.03 + 0.97 * (k + 0.5) / count, 2.39996 * k
    flat = np.sqrt(1 - up * up)
    return np.stack([flat * np.cos(angle), flat * np.sin(angle), up], axis=1).astype(np.float32)


def dappled(position: FloatArray, noise: NoiseField) -> FloatArray:
    """Sunlight that the trees let through, (N,): full in the middle, patchy towards the border."""
    # Moved along the sun's direction into one plane: what lies behind each other shares its light.
    plane = position - np.outer(position @ SUN_DIRECTION, SUN_DIRECTION)
    away = np.linalg.norm(plane - (LIT_MIDDLE - (LIT_MIDDLE @ SUN_DIRECTION) * SUN_DIRECTION), axis=1)
    leaves = noise.fbm(np.asarray(plane * 3.1 + 21, np.float32), 3)
    return 0.10 + 0.90 * smoothstep(0.34, 0.52, leaves + 0.6 * smoothstep(0.95, 0.1, away) - 0.06)


def diffuse_response(cosine: FloatArray, through: FloatArray) -> FloatArray:
    """How strongly a surface of translucency `through` (N,) answers to light at `cosine` (N,) to its normal."""
    return np.where(cosine > 0, cosine * (1 - 0.5 * through), -cosine * through)


def lit(made: Surfels, noise: NoiseField, rng: np.random.Generator) -> Light:
    """Direct sun, sky and one bounce on every surfel."""
    sun = np.zeros(len(made), np.float32)
    for direction in _around(SUN_DIRECTION, SUN_SPREAD, SUN_SAMPLES):
        sun += visibility(made.position, direction, SUN_CELL, 0.012, rng)
    sun *= dappled(made.position, noise) / SUN_SAMPLES
    sky, open_sky, weight_sum = np.zeros((3, len(made)), np.float32), np.zeros(len(made), np.float32), 1e-6
    for direction in _sky_directions(SKY_SAMPLES):
        seen = visibility(made.position, direction, SKY_CELL, 0.02, rng)
        cosine = made.normal @ direction
        sky += sky_radiance(direction[2:]).T * (seen * diffuse_response(cosine, made.translucency))
        weight = np.clip(cosine, 0.05, 1)
        open_sky += seen * weight
        weight_sum = weight_sum + weight
    open_sky /= weight_sum
    sky *= np.float32(2.0 / SKY_SAMPLES)
    sunlight = sun * diffuse_response(made.normal @ SUN_DIRECTION, made.translucency) / np.float32(np.pi)
    direct = sunlight[:, None] * SUN_RADIANCE + sky.T
    bounce = _blurred(made, made.albedo * direct)
    indirect = bounce * (1 - 0.75 * open_sky)[:, None] * 0.75 + 0.035 * linear("ffe9c8")
    # What shines through a leaf has passed its pigment twice: stronger colour, a yellower green.
    through = made.translucency[:, None] * np.array([1.0, 1.0, 0.55], np.float32) + (1 - made.translucency[:, None])
    return Light(np.asarray(made.albedo * (direct + indirect) * through, np.float32), sun, open_sky)


def _blurred(made: Surfels, leaving: FloatArray) -> FloatArray:
    """The light that leaves the surroundings of each surfel: radiance averaged over area, in soft voxels."""
    area = made.scale[:, 0] * made.scale[:, 1]
    low = made.position.min(axis=0) - 2 * BOUNCE_CELL
    cell = ((made.position - low) / np.float32(BOUNCE_CELL)).astype(np.int32)
    index = (cell[:, 0] * BOUNCE_CELLS + cell[:, 1]) * BOUNCE_CELLS + cell[:, 2]
    weights = np.concatenate([leaving * area[:, None], area[:, None]], axis=1)
    size = BOUNCE_CELLS**3
    grid = np.stack([np.bincount(index, weights[:, c], minlength=size) for c in range(4)], axis=-1)
    grid = grid.reshape(BOUNCE_CELLS, BOUNCE_CELLS, BOUNCE_CELLS, 4)
    for axis in (0, 1, 2):
        for _ in range(2):
            grid = 0.5 * grid + 0.25 * (np.roll(grid, 1, axis) + np.roll(grid, -1, axis))
    mean = grid[..., :3] / np.maximum(grid[..., 3:], 1e-9)
    return _trilinear(mean.astype(np.float32), (made.position - low) / np.float32(BOUNCE_CELL) - 0.5)


def _trilinear(grid: FloatArray, at: FloatArray) -> FloatArray:
    floor = np.floor(at).astype(np.int32)
    t = (at - floor).astype(np.float32)
    total = np.zeros((len(at), 3), np.float32)
    for corner in range(8):
        step = np.array([corner & 1, corner >> 1 & 1, corner >> 2], np.int32)
        weight = np.where(step == 1, t, 1 - t).prod(axis=1)
        i, j, k = (floor + step).T
        total += weight[:, None] * grid[i, j, k]
    return total
