# SPDX-License-Identifier: GPL-3.0-or-later
"""A shot: one scene through one camera, on the device. What every method's frame is made of."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from .buffers import Buffers
from .camera import Camera
from .device_cloud import DeviceCloud
from .maths.projection import Pose, View
from .scene import Scene
from .settings import Settings
from .staging import Staging, stage_splats
from .timing import StageTimer

if TYPE_CHECKING:
    from .rays.uploads import RasterScene


@dataclass(frozen=True, eq=False)
class Shot:
    """`clouds` and `poses` run in parallel with the scene's instances.

    `raster` gives what *rays* draws with, and makes it the first time it is asked: only that method needs a graphics
    context.
    """

    scene: Scene
    camera: Camera
    settings: Settings
    view: View
    clouds: list[DeviceCloud]
    poses: list[Pose]
    buffers: Buffers
    timer: StageTimer
    raster: Callable[[], RasterScene]

    def stage(self) -> Staging:
        """Project and colour what the camera sees: the first stage of *points* and *sorted*."""
        with self.timer.stage("stage"):
            return stage_splats(self.clouds, self.poses, self.view, self.buffers)
