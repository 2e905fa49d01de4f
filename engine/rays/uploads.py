# SPDX-License-Identifier: GPL-3.0-or-later
"""What a graphics host holds from frame to frame."""

from __future__ import annotations

from itertools import zip_longest
from typing import TYPE_CHECKING

import numpy as np

from .host import RasterHost
from .interface import INSTANCES, ORDER, SPLATS
from .order import DrawOrder, find_order, order_key
from .texels import as_rectangle, pack_instances, pack_order, splat_pages

if TYPE_CHECKING:
    from ..shot import Shot

NO_TEXELS = np.zeros((1, 1, 4), np.float32)


class RasterScene:
    """A graphics host, and which clouds and which order its textures hold: a frame uploads only what changed.

    `given_order` is drawn instead of one that is found here, for hosts that find it in another thread.
    """

    def __init__(self, host: RasterHost) -> None:
        self.host = host
        self.given_order: DrawOrder | None = None
        self.pages = 0  # of `SPLATS` in use
        self._held: list[tuple[object, str]] = []
        self._order_key: tuple[object, ...] = ()
        self._order: DrawOrder | None = None

    def upload(self, shot: Shot) -> None:
        """Clouds (if they are other ones than before) and instances."""
        looks = [pose.look for pose in shot.poses]
        instances, clouds = pack_instances(shot.scene, shot.camera, shot.clouds, looks)
        largest = self.host.largest_texture
        self.host.upload(INSTANCES, as_rectangle(instances, largest, largest, "instances"))
        storage = shot.settings.storage  # decides which splat is which
        wanted: list[tuple[object, str]] = [
            (cloud, storage) for cloud in {id(i.cloud): i.cloud for i in shot.scene.instances}.values()
        ]
        if wanted != self._held:  # clouds are equal only to themselves
            self._held, self.pages = [], 0
            pages = splat_pages(clouds, largest, len(SPLATS), shot.buffers)
            for texture, page in zip_longest(SPLATS, pages):
                self.host.upload(texture, NO_TEXELS if page is None else page)
                self.pages += page is not None
            self._held = wanted

    def upload_order(self, shot: Shot) -> DrawOrder:
        """The order of drawing, sorted and uploaded again only when the camera or the scene has changed."""
        order, key = self.given_order, order_key(shot)
        if order is None:
            order = self._order if self._order is not None and key == self._order_key else find_order(shot)
        if order is not self._order:
            self._order = None
            largest = self.host.largest_texture
            texels = pack_order(order.splat, order.instance, order.highlighted)
            self.host.upload(ORDER, as_rectangle(texels, largest, largest, "the splats in view"))
            self._order = order
        self._order_key = key
        return order
