# SPDX-License-Identifier: GPL-3.0-or-later
"""Grass and ferns."""

from __future__ import annotations

import numpy as np

from .noise import FloatArray, smoothstep
from .surfels import UP, Surfels, join, linear, mixed, normalised, strands
from .terrain import FULL_TURN, Terrain


def grass(terrain: Terrain, tufts: FloatArray, pieces: int, rng: np.random.Generator) -> Surfels:
    """Tufts (T, 4: x, y, blade count, height [units]) of arching blades, each a ribbon of `pieces` splats."""
    tuft = np.repeat(np.arange(len(tufts)), tufts[:, 2].astype(int))
    n = len(tuft)
    spread = rng.normal(0, 0.022, (n, 2)).astype(np.float32)
    x, y = (tufts[tuft, :2] + spread).T.astype(np.float32)
    root = np.stack([x, y, terrain.height(x, y) - 0.01], axis=1)
    heading = rng.uniform(0, FULL_TURN, n)
    outward = np.stack([np.cos(heading), np.sin(heading), np.zeros(n)], axis=1).astype(np.float32) + 12 * np.pad(
        spread, ((0, 0), (0, 1))
    )
    outward = normalised(outward)
    tall = (tufts[tuft, 3] * rng.uniform(0.45, 1.1, n)).astype(np.float32)
    bend = (tall * rng.uniform(0.15, 0.85, n) ** 1.3).astype(np.float32)
    t = np.linspace(0, 1, pieces + 1, dtype=np.float32)[None, :]
    rise = tall[:, None] * (t - 0.33 * (bend / tall)[:, None] * t**2.6)
    line = root[:, None] + outward[:, None] * (bend[:, None] * t**2)[..., None] + UP * rise[..., None]
    middle = (t[:, 1:] + t[:, :-1]) / 2
    width = rng.uniform(0.0055, 0.0105, n).astype(np.float32)[:, None] * np.sqrt(np.clip(1.04 - middle**1.6, 0, 1))
    twist = normalised(np.cross(outward, UP) * rng.normal(0, 0.5, (n, 1)).astype(np.float32) + UP)
    made, share = strands(line, width, np.repeat(twist[:, None], pieces, axis=1))
    which = np.repeat(np.arange(n), pieces)
    fresh = mixed(linear("24400f"), linear("86a32e"), smoothstep(0, 0.8, share))
    dry = mixed(linear("5d5420"), linear("c9ac5e"), smoothstep(0.1, 0.9, share))
    dryness = np.clip(rng.normal(0.18, 0.28, n), 0, 1).astype(np.float32)[which]
    made.albedo = mixed(fresh, dry, np.clip(dryness + 0.5 * smoothstep(0.75, 1.0, share), 0, 1))
    made.translucency[:] = 0.42
    made.gloss[:] = 0.25
    return made


def fern(
    place: tuple[float, float],
    heading: float,
    length: float,
    terrain: Terrain,
    spacing: float,
    rng: np.random.Generator,
) -> Surfels:
    """One arching frond: a stalk and toothed leaflets in pairs that shrink towards the tip."""
    x, y = (np.array([c], np.float32) for c in place)
    root = np.array([*place, terrain.height(x, y)[0] - 0.02], np.float32)
    outward = np.array([np.cos(heading), np.sin(heading), 0], np.float32)
    side = np.array([-np.sin(heading), np.cos(heading), 0], np.float32)

    def stalk_at(t: FloatArray) -> FloatArray:
        reach, rise = 0.56 * t**1.6, 0.98 * t - 0.44 * t**2.8
        return np.asarray(root + length * (outward * reach[:, None] + UP * rise[:, None]), np.float32)

    t_line = np.linspace(0, 1, 27, dtype=np.float32)
    stalk, share = strands(stalk_at(t_line)[None], np.linspace(0.011, 0.002, 26, dtype=np.float32)[None])
    stalk.albedo = mixed(linear("6b5a26"), linear("6f8c2c"), smoothstep(0.0, 0.25, share))
    pair_count = 19
    t = np.repeat(np.linspace(0.22, 0.985, pair_count, dtype=np.float32), 2)
    sign = np.tile(np.array([1, -1], np.float32), pair_count)
    base = stalk_at(t)
    forward = normalised(stalk_at(t + 0.01) - base)
    size = length * 0.33 * np.sin(np.pi * np.clip((t - 0.06) / 0.96, 0.03, 0.985)) ** 0.75 * (1.12 - 0.75 * t)
    size = (size * rng.uniform(0.92, 1.08, len(t))).astype(np.float32)
    out = normalised(side * sign[:, None] + 0.45 * forward + rng.normal(0, 0.06, (len(t), 3)).astype(np.float32))
    facing = normalised(np.cross(out, forward) * sign[:, None] * -1)
    leaflets = _leaflets(base, out, forward, facing, size, 0.0125 * length, spacing, rng)
    age = np.float32(rng.uniform(0, 1))
    leaflets.albedo *= mixed(np.ones(3, np.float32), linear("f5ee9a") * 1.25, np.array([age]))
    return join([stalk, leaflets])


def _leaflets(
    base: FloatArray,
    out: FloatArray,
    forward: FloatArray,
    facing: FloatArray,
    size: FloatArray,
    half_width: float,
    spacing: float,
    rng: np.random.Generator,
) -> Surfels:
    """Toothed leaflets: each tooth is one splat, leaning forwards from the midrib, longer near the base."""
    tooth_count = np.maximum(4, np.round(size / (1.15 * spacing))).astype(int)
    leaf = np.repeat(np.arange(len(size)), 2 * tooth_count)
    index = np.arange(len(leaf)) - np.repeat(np.cumsum(2 * tooth_count) - 2 * tooth_count, 2 * tooth_count)
    share = ((index // 2 + 0.5) / tooth_count[leaf]).astype(np.float32)
    sign = np.where(index % 2 == 0, 1, -1).astype(np.float32)
    droop = -0.16 * size[leaf] * share**2
    midrib = base[leaf] + out[leaf] * (size[leaf] * share)[:, None] + UP * droop[:, None]
    reach = half_width * np.sqrt(size[leaf] / size.max()) * (1.0 - share**2.2) + 0.002
    across = normalised(forward[leaf] - out[leaf] * (forward[leaf] * out[leaf]).sum(1, keepdims=True))
    way = normalised(across * sign[:, None] + 0.5 * out[leaf])
    line = np.stack([midrib, midrib + way * reach[:, None]], axis=1)
    width = (size[leaf] / tooth_count[leaf] * 0.88).astype(np.float32)
    cupped = normalised(facing[leaf] + 0.25 * across * sign[:, None] + rng.normal(0, 0.08, midrib.shape))
    made, _ = strands(line, width[:, None], cupped[:, None])
    made.scale[:, 0] *= 0.95
    made.scale[:, 2] = 0.0008
    green = mixed(
        linear("3f6418"), linear("77992c"), rng.uniform(0, 1, len(leaf)).astype(np.float32) * 0.5 + 0.3 * share
    )
    made.albedo = green * rng.uniform(0.8, 1.2, len(size)).astype(np.float32)[leaf, None]
    made.translucency[:] = 0.45
    made.gloss[:] = 0.15
    return made
