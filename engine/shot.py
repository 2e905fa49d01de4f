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
from .occlusion import OcclusionMemory
from .placements import Placements
from .scene import Scene
from .settings import Settings
from .staging import Staging, stage_all
from .timing import StageTimer

if TYPE_CHECKING:
    from .rays.uploads import RasterScene


@dataclass(frozen=True, eq=False)
class Shot:
    """`clouds` and `poses` run in parallel with the scene's instances; `placements` has both on the device.

    `occlusion_memory` remembers from sample to sample and from frame to frame what hid the rest.

    `raster` gives what *rays* draws with, and makes it the first time it is asked: only that method needs a graphics
    context.
    """

    scene: Scene
    camera: Camera
    settings: Settings
    view: View
    clouds: list[DeviceCloud]
    poses: list[Pose]
    placements: Placements
    occlusion_memory: OcclusionMemory
    buffers: Buffers
    timer: StageTimer
    raster: Callable[[], RasterScene]

    def stage(self) -> Staging:
        """Project and colour all that is in the frustum, for methods that need it all at once."""
        with self.timer.stage("stage"):
            return stage_all(self.placements, self.view, self.buffers, bounded=self.settings.culling != "none")
