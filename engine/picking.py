# SPDX-License-Identifier: GPL-3.0-or-later
"""Which splat is seen at a pixel: what may be seen in that pixel alone is blended, as *sorted* or as *rays* does."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from .camera import Camera
from .rays.meet import meet_ray
from .renderer import Renderer
from .scene import Scene
from .settings import Settings
from .shot import Shot
from .timing import StageTimer

Met = tuple[npt.NDArray[Any], npt.NDArray[Any], npt.NDArray[np.float64], npt.NDArray[np.float64]]

HALF = 0.5  # the splat that leaves less than half of the light is the one that is seen


@dataclass(frozen=True)
class Pick:
    """`splat` is an index in the instance's cloud as it lies on the device; `depth` is along z [world units]."""

    instance: int
    splat: int
    depth: float
    position_world: npt.NDArray[np.float64]


def pick(
    renderer: Renderer,
    scene: Scene,
    camera: Camera,
    x: int,
    y: int,
    settings: Settings | None = None,
    progress: Callable[[float, str], None] | None = None,
) -> Pick | None:
    """What is seen in the centre of pixel (x, y) of the frame, counted from the top left; None where less than half is.

    By `settings`, as *rays* (which needs no graphics for this) or, for the other methods and by default, as *sorted*.
    `position_world` lies on the ray through the pixel at the splat's depth: of its mean, or as *rays* where the ray
    meets its greatest density. Reads a few groups of splats, whatever the scene's size. Raises StippleError for a pixel
    outside the frame.
    """
    settings = settings or Settings(method="sorted")
    small = replace(camera, window=(x, y, 1, 1))
    shot = renderer.shot(scene, small, settings, StageTimer(renderer.device), progress)
    meet: Callable[..., Met] = meet_ray if settings.method == "rays" else _meet_ellipses
    splat, instance, alpha, depth = meet(shot, x + 0.5, y + 0.5)
    through = np.cumprod(1.0 - alpha)
    if len(through) == 0 or through[-1] >= HALF:
        return None
    first = int(np.argmax(through < HALF))
    at = float(depth[first])
    return Pick(int(instance[first]), int(splat[first]), at, _on_ray(camera, x + 0.5, y + 0.5, at))


def _meet_ellipses(shot: Shot, x_px: float, y_px: float) -> Met:
    """(splat, instance, opacity, depth of the mean) front to back at a point of the frame [px], as *sorted* blends."""
    staging, settings = shot.stage(), shot.settings
    if staging.count == 0:
        nothing = np.zeros(0)
        return nothing, nothing, nothing, nothing
    centre = staging.arrays.centre.numpy().astype(np.float64)
    xx, xy, yy, determinant = staging.arrays.covariance.numpy().astype(np.float64).T
    dx, dy = x_px - centre[:, 0], y_px - centre[:, 1]
    power = -0.5 * (yy * dx * dx - 2 * xy * dx * dy + xx * dy * dy) / determinant
    alpha = np.minimum(centre[:, 3] * np.exp(power), settings.alpha_max)
    alpha[alpha < settings.alpha_min] = 0.0
    order = np.argsort(centre[:, 2], kind="stable")
    splat, instance = staging.arrays.splat.numpy(), staging.arrays.instance.numpy()
    return splat[order], instance[order], alpha[order], centre[order, 2]


def _on_ray(camera: Camera, x_px: float, y_px: float, depth: float) -> npt.NDArray[np.float64]:
    scale = depth if camera.projection == "pinhole" else 1.0
    in_camera = np.array([(x_px - camera.cx) / camera.fx * scale, (y_px - camera.cy) / camera.fy * scale, depth])
    linear, translation = camera.camera_from_world[:, :3], camera.camera_from_world[:, 3]
    return np.linalg.solve(linear, in_camera - translation)
