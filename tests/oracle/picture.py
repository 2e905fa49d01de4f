# SPDX-License-Identifier: GPL-3.0-or-later
"""The oracle's entry point: a scene and a camera to a picture."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .blend import BlendInput, blend
from .look import graded, looked, overridden
from .projection import project, view_directions
from .scene_like import CameraLike, Float64Array, SceneLike
from .sh import colour


@dataclass(frozen=True, eq=False)
class OraclePicture:
    """What must be seen.

    - `rgba` (H, W, 4) float64: rows from the top, sRGB-encoded, premultiplied (the blend space); alpha is 1
      everywhere when the scene has a background.
    - `depth` (H, W) float64: mean camera-space z of the splats, weighted as their colours are [world units]; +inf where
      none is seen. The background has no depth and does not dilute it.

    Both have the size of the camera's window where it has one.
    """

    rgba: Float64Array
    depth: Float64Array


def render(
    scene: SceneLike,
    camera: CameraLike,
    *,
    alpha_min: float = 1.0 / 255.0,
    alpha_max: float = 0.99,
    dilation_px2: float = 0.3,
    antialiased: bool = False,
    supersampling: int = 1,
    sh_degree: int | None = None,
) -> OraclePicture:
    """Render all instances as if they were one cloud, nearest mean first, ties in the order of the scene.

    Parameters mean what they mean in the engine's settings; the dilation is in full-pixel units whatever the
    supersampling. Does not model INRIA's early stop at a transmittance of 1e-4 (worth at most that much colour), its
    cut at three standard deviations, or float32.
    """
    splats = gather(scene, camera, alpha_min, dilation_px2, antialiased, sh_degree)
    window = camera.window or (0, 0, camera.width, camera.height)
    sums = blend(splats, window, supersampling=supersampling, alpha_min=alpha_min, alpha_max=alpha_max)
    rgb, alpha = sums.colour, sums.weight
    if scene.background is not None:
        rgb = rgb + sums.transmittance[..., None] * np.asarray(scene.background, dtype=np.float64)
        alpha = np.ones_like(alpha)
    seen = sums.weight > 0
    depth = np.full(seen.shape, np.inf)
    depth[seen] = sums.weighted_depth[seen] / sums.weight[seen]
    return OraclePicture(np.concatenate([rgb, alpha[..., None]], axis=-1), depth)


def gather(
    scene: SceneLike,
    camera: CameraLike,
    alpha_min: float,
    dilation_px2: float,
    antialiased: bool,
    sh_degree: int | None,
) -> BlendInput:
    """Every visible splat of every instance, in the order that decides ties: instance, then splat."""
    parts = [BlendInput(np.zeros((0, 2)), np.zeros((0, 2, 2)), np.zeros(0), np.zeros(0), np.zeros((0, 3)))]
    for placed in scene.instances:
        instance, (compensated, degree) = looked(placed), overridden(placed, antialiased, sh_degree)
        seen = project(instance, camera, dilation_px2=dilation_px2, antialiased=compensated, alpha_min=alpha_min)
        directions = view_directions(instance, camera, seen.index)
        cloud = instance.cloud
        rgb = graded(colour(cloud.sh_dc[seen.index], cloud.sh_rest[seen.index], directions, degree), placed)
        finite = np.isfinite(rgb).all(axis=1)
        arrays = (seen.mean_px, seen.covariance_px2, seen.depth, seen.opacity, rgb)
        parts.append(BlendInput(*(array[finite] for array in arrays)))
    names = ("mean_px", "covariance_px2", "depth", "opacity", "colour")
    return BlendInput(*(np.concatenate([getattr(part, name) for part in parts]) for name in names))
