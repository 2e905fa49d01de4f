# SPDX-License-Identifier: GPL-3.0-or-later
"""Cameras for a capture that came without any: framed by what is in it, on a circle around it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from .camera import INRIA_NEAR, Camera, look_at
from .errors import StippleError
from .splats import SplatCloud

# Up axis -> (up, where the first view stands), unit vectors. -y is up in what COLMAP-based trainers write.
UP_AXES = {
    "-y": ((0, -1, 0), (0, 0, 1)),
    "y": ((0, 1, 0), (0, 0, 1)),
    "-z": ((0, 0, -1), (0, 1, 0)),
    "z": ((0, 0, 1), (0, -1, 0)),
    "-x": ((-1, 0, 0), (0, 0, 1)),
    "x": ((1, 0, 0), (0, 0, 1)),
}
EDGE = 0.05  # share of the opacity cut off at either end of an axis before the middle is taken
INSIDE = 0.9  # share of the opacity inside the framed sphere
SAMPLED_SPLATS = 1_000_000  # per cloud; the framing does not change visibly with more


@dataclass(frozen=True)
class Framing:
    """The sphere a camera should show: `centre` (3,) float64 and `radius` [world units]."""

    centre: npt.NDArray[np.float64]
    radius: float


def frame_clouds(clouds: Sequence[SplatCloud]) -> Framing:
    """The sphere that holds what is seen of the clouds, taken where they lie (object space as world space).

    Captures have floaters and a distant shell, so no minimum or maximum is used: the centre is the middle between
    the 5 % and 95 % quantiles along each axis and the radius holds 90 % around it, every splat weighted with its
    opacity. Clouds of more than a million splats are sampled at even steps. Raises StippleError without clouds.
    """
    if not clouds:
        raise StippleError("orbit: there is nothing to look at; give at least one capture.")
    positions, weights = [], []
    for cloud in clouds:
        step = -(-cloud.splat_count // SAMPLED_SPLATS)
        positions.append(cloud.position[::step].astype(np.float64))
        # A faint splat still counts a little, or an all but transparent cloud would have no place.
        weights.append(np.maximum(cloud.opacity[::step].astype(np.float64), 1e-6) * step)
    position, weight = np.concatenate(positions), np.concatenate(weights)
    edges = np.array([weighted_quantiles(position[:, axis], weight, (EDGE, 1.0 - EDGE)) for axis in range(3)])
    centre = edges.mean(axis=1)
    distance = np.linalg.norm(position - centre, axis=1)
    radius = float(weighted_quantiles(distance, weight, (INSIDE,))[0])
    if radius <= 0.0:  # one splat, or all in one place: its own size is all there is to frame
        radius = 3.0 * max(float(cloud.scale.max()) for cloud in clouds) or 1.0
    return Framing(centre, radius)


def weighted_quantiles(
    values: npt.NDArray[np.float64], weights: npt.NDArray[np.float64], shares: Sequence[float]
) -> npt.NDArray[np.float64]:
    """For each share the smallest value at which the weights up to it reach that share of their sum."""
    order = np.argsort(values)
    cumulative = np.cumsum(weights[order])
    index = np.searchsorted(cumulative, np.asarray(shares) * cumulative[-1])
    return np.asarray(values[order][np.minimum(index, len(values) - 1)])


def orbit(
    framing: Framing,
    count: int,
    *,
    width: int = 1280,
    height: int = 720,
    fov_y: float = np.pi / 4,
    elevation: float = np.pi / 18,
    up: str = "-y",
) -> tuple[Camera, ...]:
    """`count` pinhole cameras at even steps around `framing`, all looking at its centre.

    - `fov_y`: vertical field of view [rad]. The distance is the one at which the sphere touches the nearer pair of
      picture edges.
    - `elevation`: of the cameras above the centre [rad], between straight down and straight up.
    - `up`: "-y", "y", "-z", "z", "-x" or "x". The first view stands where viewers with that
      up axis put the front (+z for y and -y, −y for z as in Blender); the next ones follow anticlockwise seen
      from above.

    Raises StippleError for a value outside its range.
    """
    _check(count, width, height, fov_y, elevation, up)
    up_axis, front = (np.array(axis, dtype=np.float64) for axis in UP_AXES[up])
    side = np.cross(up_axis, front)
    focal = height / 2 / np.tan(fov_y / 2)
    half_angle = np.arctan(min(width, height) / 2 / focal)
    distance = framing.radius / np.sin(half_angle)
    cameras = []
    for angle in 2 * np.pi * np.arange(count) / count:
        around = np.cos(angle) * front + np.sin(angle) * side
        eye = framing.centre + distance * (np.cos(elevation) * around + np.sin(elevation) * up_axis)
        cameras.append(
            Camera(
                camera_from_world=look_at(eye, framing.centre, up_axis),
                width=width,
                height=height,
                fx=focal,
                fy=focal,
                cx=width / 2,
                cy=height / 2,
                near=min(INRIA_NEAR, 0.02 * distance),  # a capture in millimetres must not vanish
                far=max(1e6, 100 * distance),
            )
        )
    return tuple(cameras)


def _check(count: int, width: int, height: int, fov_y: float, elevation: float, up: str) -> None:
    if count < 1:
        raise StippleError(f"orbit: {count} views asked for; give at least 1.")
    if width < 1 or height < 1:
        raise StippleError(f"orbit: the frame is {width}×{height} px; give at least 1×1.")
    if not 0 < fov_y < np.pi:
        raise StippleError(f"orbit: the field of view is {np.degrees(fov_y):g}°; give one between 0° and 180°.")
    if not -np.pi / 2 < elevation < np.pi / 2:
        raise StippleError(f"orbit: the elevation is {np.degrees(elevation):g}°; give one between -90° and 90°.")
    if up not in UP_AXES:
        raise StippleError(f"orbit: the up axis is {up!r}; choose one of {', '.join(UP_AXES)}.")
