# SPDX-License-Identifier: GPL-3.0-or-later
"""Small scenes in the engine's types, for tests of the renderers."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from stipple.engine.camera import Camera
from stipple.engine.scene import Instance, Scene
from stipple.engine.splats import ARRAY_NAMES, SH_C0, SH_REST_COUNT, SplatCloud

FRAME = (64, 48)  # width, height [px]
FOCAL_PX = 60.0


def front_camera(width: int = FRAME[0], height: int = FRAME[1], **changes: Any) -> Camera:
    """At the origin, looking along +z; a splat at depth z and scale s has s · 60 / z pixels of standard deviation."""
    values: dict[str, Any] = {
        "camera_from_world": np.eye(3, 4),
        "width": width,
        "height": height,
        "fx": FOCAL_PX,
        "fy": FOCAL_PX,
        "cx": width / 2,
        "cy": height / 2,
        "near": 0.2,
        "far": 1000.0,
    }
    return Camera(**(values | changes))


def cloud_of(
    position: npt.ArrayLike,
    scale: npt.ArrayLike,
    opacity: npt.ArrayLike,
    colour: npt.ArrayLike,
    rotation: npt.ArrayLike = (1.0, 0.0, 0.0, 0.0),
    sh_rest: npt.ArrayLike | None = None,
) -> SplatCloud:
    """Splats from values that broadcast to (N, …); `colour` is the base colour, 0 … 1 sRGB-encoded."""
    position = np.atleast_2d(np.asarray(position, np.float32))
    n = len(position)

    def rows(values: npt.ArrayLike, columns: int) -> npt.NDArray[np.float32]:
        return np.ascontiguousarray(np.broadcast_to(np.asarray(values, np.float32), (n, columns)))

    rest = np.zeros((n, 0, 3)) if sh_rest is None else sh_rest
    quaternion = rows(rotation, 4)
    return SplatCloud(
        position=np.ascontiguousarray(position),
        scale=rows(np.reshape(scale, (-1, 1)) if np.ndim(scale) == 1 and np.size(scale) == n != 3 else scale, 3),
        rotation=quaternion / np.linalg.norm(quaternion, axis=1, keepdims=True),
        opacity=np.ascontiguousarray(np.broadcast_to(np.asarray(opacity, np.float32), (n,))),
        sh_dc=rows((np.asarray(colour, np.float32) - 0.5) / SH_C0, 3),
        sh_rest=np.ascontiguousarray(rest, np.float32),
    )


def scene_of(*clouds: SplatCloud, background: tuple[float, float, float] | None = None) -> Scene:
    return Scene(tuple(Instance(cloud) for cloud in clouds), background)


def random_cloud(
    count: int,
    seed: int,
    *,
    sigma_px: Sequence[float] = (2.0, 8.0),
    opacity: Sequence[float] = (0.05, 1.0),
    sh_degree: int = 0,
) -> SplatCloud:
    """Splats of random shape all over the front camera's frame, some reaching out of it.

    `sigma_px` bounds the standard deviations along the axes as seen at the splat's depth [px].
    """
    rng = np.random.default_rng(seed)
    depth = rng.uniform(2.0, 6.0, count)
    half = np.array(FRAME) / 2
    px = rng.uniform(-1.1, 1.1, (count, 2)) * half
    position = np.column_stack([px * (depth / FOCAL_PX)[:, None], depth])
    scale = np.exp(rng.uniform(*np.log(sigma_px), (count, 3))) * (depth / FOCAL_PX)[:, None]
    return cloud_of(
        position,
        scale,
        rng.uniform(*opacity, count),
        rng.uniform(0.0, 1.0, (count, 3)),
        rng.normal(size=(count, 4)),
        rng.normal(0.0, 0.15, (count, SH_REST_COUNT[sh_degree], 3)),
    )


def absurd_cloud() -> SplatCloud:
    """Every field holds every kind of nonsense once, among some honest splats."""
    bad = np.array([np.nan, np.inf, -np.inf, 0.0, 1e30, -1e30, 1e-30, -1.0, 3e38], np.float32)
    good = random_cloud(12 * len(bad) + 10, 5, sh_degree=2)
    arrays = {name: np.array(getattr(good, name)) for name in ARRAY_NAMES}
    row = 0
    for array in arrays.values():
        for value in bad:
            array.reshape(len(array), -1)[row, 0] = value  # in one component
            array[row + 1] = value  # in all
            row += 2
    return SplatCloud(**arrays)
