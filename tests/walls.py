# SPDX-License-Identifier: GPL-3.0-or-later
"""Two walls that cross in front of the camera: as splats, as planes, and which of them a pixel must show."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

from stipple.engine.splats import SplatCloud

from .scenes import cloud_of

WIDTH, HEIGHT, FOCAL_PX = 128, 96, 200.0  # of the front camera that sees them
MIDDLE = np.array([0.0, 0.0, 4.0])
TURNS = (Rotation.from_euler("yx", [10, 10], degrees=True), Rotation.from_euler("yx", [-45, -20], degrees=True))
HALF_SIZE, PITCH = 4.5, 0.25

Floats = npt.NDArray[np.float64]


def wall(index: int, colour: tuple[float, float, float]) -> SplatCloud:
    """A wall of flat, opaque splats some ten pixels large, through MIDDLE, in camera space."""
    rng = np.random.default_rng(index)
    across = np.arange(-HALF_SIZE, HALF_SIZE + PITCH / 2, PITCH)
    grid = np.stack(np.meshgrid(across, across), -1).reshape(-1, 2)
    flat = np.column_stack([grid + rng.uniform(-0.05, 0.05, grid.shape), np.zeros(len(grid))])
    x, y, z, w = TURNS[index].as_quat()
    return cloud_of(TURNS[index].apply(flat) + MIDDLE, [[0.2, 0.2, 1e-4]], 1.0, colour, [w, x, y, z])


def corners(index: int) -> Floats:
    """(4, 3): the same wall as a rectangle."""
    flat = HALF_SIZE * np.array([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
    return np.asarray(TURNS[index].apply(flat) + MIDDLE)


def depths() -> Floats:
    """(2, H, W): z at which each pixel's ray meets each wall."""
    x, y = np.meshgrid(np.arange(WIDTH) + 0.5 - WIDTH / 2, np.arange(HEIGHT) + 0.5 - HEIGHT / 2)
    rays = np.stack([x / FOCAL_PX, y / FOCAL_PX, np.ones_like(x)], -1)
    normals = [turn.apply([0.0, 0.0, 1.0]) for turn in TURNS]
    return np.stack([(normal @ MIDDLE) / (rays @ normal) for normal in normals])


def misplaced(first_is_seen: npt.NDArray[np.bool_]) -> Floats:
    """(H, W): how far from the line where the walls cross a pixel shows the farther one [px along its row], else 0."""
    difference = np.subtract(*depths())  # < 0: the first is nearer
    slope = np.abs(np.gradient(difference, axis=1))
    return np.where(first_is_seen != (difference < 0), np.abs(difference) / slope, 0.0)
