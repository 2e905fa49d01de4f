# SPDX-License-Identifier: GPL-3.0-or-later
"""What a graphics host holds from frame to frame."""

from __future__ import annotations

import numpy as np

from ..camera import Camera
from ..scene import Scene
from .host import RasterHost
from .interface import INSTANCES, SPLATS
from .texels import as_rectangle, pack_cloud, pack_instances


class RasterScene:
    """A graphics host and which clouds its texture holds, so that a frame uploads only what changed."""

    def __init__(self, host: RasterHost) -> None:
        self.host = host
        self._held: list[object] = []

    def upload(self, scene: Scene, camera: Camera) -> None:
        """Clouds (if they are other ones than before) and instances."""
        instances, clouds = pack_instances(scene, camera)
        largest = self.host.largest_texture
        self.host.upload(INSTANCES, as_rectangle(instances, largest, largest, "instances"))
        if len(clouds) != len(self._held) or any(a is not b for a, b in zip(clouds, self._held, strict=True)):
            self._held = []
            records = [pack_cloud(cloud).reshape(-1, 4) for cloud in clouds]
            texels = np.concatenate(records) if records else np.zeros((0, 4), np.float32)
            self.host.upload(SPLATS, as_rectangle(texels, largest, largest, "the captures"))
            self._held = list(clouds)
