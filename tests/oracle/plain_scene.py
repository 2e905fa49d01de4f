# SPDX-License-Identifier: GPL-3.0-or-later
"""Small scenes for the oracle's own tests, built without the engine."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from .scene_like import Float64Array

SH_C0 = 0.5 / np.sqrt(np.pi)


@dataclass(frozen=True, eq=False)
class PlainCloud:
    """N splats; see `scene_like.SplatCloudLike`."""

    position: Float64Array
    scale: Float64Array
    rotation: Float64Array
    opacity: Float64Array
    sh_dc: Float64Array
    sh_rest: Float64Array


@dataclass(frozen=True, eq=False)
class PlainInstance:
    """A placement; see `scene_like.InstanceLike`."""

    cloud: PlainCloud
    world_from_object: Float64Array = field(default_factory=lambda: np.eye(3, 4))


@dataclass(frozen=True, eq=False)
class PlainScene:
    """Instances and a background; see `scene_like.SceneLike`."""

    instances: tuple[PlainInstance, ...]
    background: tuple[float, float, float] | None = None


@dataclass(frozen=True, eq=False)
class PlainCamera:
    """A camera at the origin that looks along +z unless told otherwise; see `scene_like.CameraLike`."""

    camera_from_world: Float64Array = field(default_factory=lambda: np.eye(3, 4))
    width: int = 32
    height: int = 24
    fx: float = 40.0
    fy: float = 40.0
    cx: float = 16.0
    cy: float = 12.0
    near: float = 0.2
    far: float = 1e6
    projection: str = "pinhole"
    window: tuple[int, int, int, int] | None = None


def cloud_of(
    position: npt.ArrayLike,
    *,
    scale: npt.ArrayLike = 0.2,
    rotation: npt.ArrayLike = (1.0, 0.0, 0.0, 0.0),
    opacity: npt.ArrayLike = 0.8,
    rgb: npt.ArrayLike = (1.0, 0.5, 0.25),
    sh_rest: npt.ArrayLike | None = None,
) -> PlainCloud:
    """A cloud at `position` (N, 3); the other values broadcast to every splat. `rgb` is the base colour."""
    places = np.atleast_2d(np.asarray(position, dtype=np.float64))
    n = len(places)
    rest = np.zeros((n, 0, 3)) if sh_rest is None else np.asarray(sh_rest, dtype=np.float64)
    return PlainCloud(
        position=places,
        scale=np.array(np.broadcast_to(np.asarray(scale, dtype=np.float64), (n, 3))),
        rotation=np.array(np.broadcast_to(np.asarray(rotation, dtype=np.float64), (n, 4))),
        opacity=np.array(np.broadcast_to(np.asarray(opacity, dtype=np.float64), (n,))),
        sh_dc=(np.array(np.broadcast_to(np.asarray(rgb, dtype=np.float64), (n, 3))) - 0.5) / SH_C0,
        sh_rest=rest,
    )


def scene_of(*clouds: PlainCloud, background: tuple[float, float, float] | None = None) -> PlainScene:
    """One untransformed instance of each cloud."""
    return PlainScene(tuple(PlainInstance(cloud) for cloud in clouds), background)


def random_cloud(seed: int, count: int, *, degree: int = 0) -> PlainCloud:
    """Splats of random shape, place and colour in front of the default camera."""
    rng = np.random.default_rng(seed)
    depth = rng.uniform(2.0, 6.0, count)
    position = np.stack([rng.uniform(-0.4, 0.4, count) * depth, rng.uniform(-0.3, 0.3, count) * depth, depth], axis=1)
    return cloud_of(
        position,
        scale=rng.uniform(0.02, 0.5, (count, 3)),
        rotation=rng.normal(size=(count, 4)),
        opacity=rng.uniform(0.05, 1.0, count),
        rgb=rng.uniform(0.0, 1.0, (count, 3)),
        sh_rest=rng.normal(scale=0.3, size=(count, (degree + 1) ** 2 - 1, 3)),
    )
