# SPDX-License-Identifier: GPL-3.0-or-later
"""Moss: a pile of short fibres, and the stalks with spore capsules that rise from it."""

from __future__ import annotations

import numpy as np

from .noise import FloatArray, NoiseField, smoothstep
from .surfels import UP, Surfels, join, linear, mixed, normalised, strands


def moss_fibres(
    ground: Surfels, moss: FloatArray, count: int, noise: NoiseField, rng: np.random.Generator, length: float = 0.012
) -> Surfels:
    """`count` short upright fibres [length in units] on `ground`, as dense as its `moss` (N,) says."""
    weight = np.cumsum(moss**2 * ground.scale[:, 0] * ground.scale[:, 1], dtype=np.float64)
    root = np.searchsorted(weight, (np.arange(count) + rng.random(count)) / count * weight[-1])
    root = np.minimum(root, len(moss) - 1)
    base, normal, spread = ground.position[root], ground.normal[root], ground.scale[root, :1]
    across = rng.normal(size=(count, 3)).astype(np.float32)
    height = rng.random(count, dtype=np.float32)
    way = normalised(normal + 0.4 * UP + 0.55 * across)
    tuft = noise.fbm(base * 34, 2)
    tall = np.float32(length) * (0.45 + 1.1 * tuft)
    centre = base + across * spread * 1.2 + way * (tall * (0.15 + 0.85 * height))[:, None]
    half = np.stack([0.30 * tall, 0.08 * tall + 0.0009, 0.06 * tall + 0.0007], axis=1)
    made, _ = strands(np.stack([centre - way * half[:, :1], centre + way * half[:, :1]], axis=1), 2 * half[:, 1:2])
    made.normal = normalised(normal + 0.5 * across)
    made.tangent = normalised(way - made.normal * (way * made.normal).sum(1, keepdims=True))
    made.scale = half.astype(np.float32)
    hue = noise.fbm(base * 3.5 + 50, 3)
    dark = mixed(linear("35480f"), linear("565a16"), smoothstep(0.4, 0.6, hue))
    light = mixed(linear("7d9a2a"), linear("bfb53e"), smoothstep(0.45, 0.62, hue))
    made.albedo = mixed(dark, light, np.clip(0.15 + 0.45 * height + 1.4 * (tuft - 0.42), 0, 1))
    made.translucency[:] = 0.3
    return made


def sporophytes(ground: Surfels, moss: FloatArray, count: int, rng: np.random.Generator) -> Surfels:
    """Thin rust-coloured stalks with nodding capsules that stand out of the moss."""
    candidates = np.flatnonzero((moss > 0.8) & (ground.normal[:, 2] > 0.75))
    patches = rng.choice(candidates, max(1, count // 5))
    near = ground.position[candidates]
    chosen = []
    for patch in patches:
        close = candidates[np.linalg.norm(near - ground.position[patch], axis=1) < 0.06]
        chosen.append(rng.choice(close, min(5, len(close)), replace=False))
    root = ground.position[np.concatenate(chosen)]
    n = len(root)
    sway = rng.normal(0, 0.012, (n, 1, 3)).astype(np.float32) * np.array([1, 1, 0], np.float32)
    t = np.linspace(0, 1, 5, dtype=np.float32)[None, :, None]
    tall = rng.uniform(0.05, 0.085, (n, 1, 1)).astype(np.float32)
    line = root[:, None] + UP * tall * t + sway * t**2
    stalk, share = strands(line, np.full((n, 4), 0.0017, np.float32))
    stalk.albedo = mixed(linear("6d8a2a"), linear("a8683a"), share)
    tip = line[:, -1]
    droop = normalised(sway[:, 0] + np.float32(0.004) * UP)
    pod, _ = strands(np.stack([tip, tip + droop * 0.011], axis=1), np.full((n, 1), 0.0065, np.float32))
    pod.albedo[:] = linear("b8702c")
    for part in (stalk, pod):
        part.translucency[:] = 0.3
    return join([stalk, pod])
