# SPDX-License-Identifier: GPL-3.0-or-later
"""Which splat is seen at a pixel: groups are culled to that pixel, and what remains is blended as *sorted* does."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from .camera import Camera
from .renderer import Renderer
from .scene import Scene
from .settings import Settings
from .timing import StageTimer

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

    `position_world` lies on the ray through the pixel at the splat's depth, not at its mean. Reads a few groups of
    splats, whatever the scene's size. Raises StippleError for a pixel outside the frame.
    """
    settings = settings or Settings(method="sorted")
    small = replace(camera, window=(x, y, 1, 1))
    shot = renderer.shot(scene, small, settings, StageTimer(renderer.device), progress)
    staging = shot.stage()
    if staging.count == 0:
        return None
    centre = staging.arrays.centre.numpy().astype(np.float64)
    xx, xy, yy, determinant = staging.arrays.covariance.numpy().astype(np.float64).T
    dx, dy = x + 0.5 - centre[:, 0], y + 0.5 - centre[:, 1]
    power = -0.5 * (yy * dx * dx - 2 * xy * dx * dy + xx * dy * dy) / determinant
    alpha = np.minimum(centre[:, 3] * np.exp(power), settings.alpha_max)
    alpha[alpha < settings.alpha_min] = 0.0
    order = np.argsort(centre[:, 2], kind="stable")
    through = np.cumprod(1.0 - alpha[order])
    first = int(np.argmax(through < HALF))
    if through[first] >= HALF:
        return None
    record = order[first]
    depth = float(centre[record, 2])
    return Pick(
        instance=int(staging.arrays.instance.numpy()[record]),
        splat=int(staging.arrays.splat.numpy()[record]),
        depth=depth,
        position_world=_on_ray(camera, x + 0.5, y + 0.5, depth),
    )


def _on_ray(camera: Camera, x_px: float, y_px: float, depth: float) -> npt.NDArray[np.float64]:
    scale = depth if camera.projection == "pinhole" else 1.0
    in_camera = np.array([(x_px - camera.cx) / camera.fx * scale, (y_px - camera.cy) / camera.fy * scale, depth])
    linear, translation = camera.camera_from_world[:, :3], camera.camera_from_world[:, 3]
    return np.linalg.solve(linear, in_camera - translation)
