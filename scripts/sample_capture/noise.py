# SPDX-License-Identifier: GPL-3.0-or-later
"""Smooth random fields over space: what makes procedural materials look grown instead of computed."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.floating[Any]]  # float32 where it is kept, either where it is passing

TABLE_BITS = 6  # the lattice repeats every 64 cells, far beyond what one object spans


def smoothstep(low: float, high: float, value: FloatArray) -> FloatArray:
    """Cubic ramp from 0 at `low` to 1 at `high`; falls where `low` is the larger."""
    t = np.clip((value - np.float32(low)) / np.float32(high - low), 0, 1)
    return np.asarray(t * t * (3 - 2 * t), dtype=np.float32)


class NoiseField:
    """Value noise in three dimensions, quintic interpolation of a periodic lattice of random numbers.

    Deterministic for a generator's state. Points are float32 (N, 3); one unit is one lattice cell.
    """

    def __init__(self, rng: np.random.Generator) -> None:
        size = 1 << TABLE_BITS
        self._table = rng.random(size**3, dtype=np.float32)

    def __call__(self, points: FloatArray) -> FloatArray:
        """Noise at the points, (N,) float32 in 0 … 1 with mean 0.5."""
        floor = np.floor(points)
        t = (points - floor).astype(np.float32)
        t = t * t * t * (t * (t * 6 - 15) + 10)
        mask = (1 << TABLE_BITS) - 1
        low = floor.astype(np.int32) & mask
        high = (low + 1) & mask
        corner = [low << np.array([12, 6, 0], np.int32), high << np.array([12, 6, 0], np.int32)]
        along_x = []
        for a in (0, 1):
            for b in (0, 1):
                base = corner[a][:, 1] | corner[b][:, 2]
                at_low, at_high = self._table[base | corner[0][:, 0]], self._table[base | corner[1][:, 0]]
                along_x.append(at_low + (at_high - at_low) * t[:, 0])
        near = along_x[0] + (along_x[1] - along_x[0]) * t[:, 2]
        far = along_x[2] + (along_x[3] - along_x[2]) * t[:, 2]
        return np.asarray(near + (far - near) * t[:, 1], dtype=np.float32)

    def fbm(self, points: FloatArray, octaves: int = 4, gain: float = 0.5) -> FloatArray:
        """Sum of `octaves` of noise, each twice as fine and `gain` times as strong; 0 … 1 with mean 0.5."""
        total, weight_sum, weight, frequency = np.zeros(len(points), np.float32), 0.0, 1.0, 1.0
        for octave in range(octaves):
            shift = np.float32(17.13 * octave)
            total += np.float32(weight) * self(np.asarray(points * np.float32(frequency) + shift, np.float32))
            weight_sum += weight
            weight *= gain
            frequency *= 2.03
        return total / np.float32(weight_sum)

    def ridged(self, points: FloatArray, octaves: int = 4) -> FloatArray:
        """Like `fbm`, with sharp crests: 0 … 1, near 1 along narrow winding lines."""
        total, weight_sum = np.zeros(len(points), np.float32), 0.0
        for octave in range(octaves):
            weight = 0.5**octave
            sample = self(np.asarray(points * np.float32(2.07**octave) + np.float32(9.7 * octave), np.float32))
            total += np.float32(weight) * (1 - np.abs(2 * sample - 1))
            weight_sum += weight
        return total / np.float32(weight_sum)
