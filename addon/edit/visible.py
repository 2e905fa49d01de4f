# SPDX-License-Identifier: GPL-3.0-or-later
"""What an edit sees through a view: the point under the cursor, the splats that others do not hide."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import bpy
import numpy as np
import numpy.typing as npt

from ...engine.camera import Camera
from ...engine.scene import Instance, Scene
from ...engine.settings import Settings
from .. import residency, sync
from ..kept_for_file import kept_for_file
from .editing_device import editing_device
from .operator import world_from_object
from .screen import look_in
from .session import EditSession

if TYPE_CHECKING:
    from ...engine.edit.mask import Mask
    from ...engine.picking import Pick
    from ...engine.renderer import Renderer

_renderers: dict[str, Renderer] = {}  # by device; at most one


def visible_mask(context: Any, session: EditSession, camera: Camera) -> Mask:
    """The splats of the edited capture of which the camera sees something."""
    return session.visible(camera, _renderer(context, "points"), world_from_object(context), look_in(context))


class Picker:
    """Finds what is under the cursor in one view, of captures as they are when it is made."""

    def __init__(self, context: Any, instances: tuple[Instance, ...], camera: Camera) -> None:
        self._context, self._scene, self._camera = context, Scene(instances), camera

    @classmethod
    def of_session(cls, context: Any, session: EditSession, camera: Camera) -> Picker:
        """Of the edited capture alone."""
        return cls(context, session.instances(world_from_object(context), look_in(context)), camera)

    def pick(self, x: float, y: float) -> Pick | None:
        """The splat seen at a pixel from the bottom left; None where nothing is, or outside the view."""
        from ...engine.picking import pick

        row, column = self._camera.height - 1 - int(np.floor(y)), int(np.floor(x))
        if not (0 <= column < self._camera.width and 0 <= row < self._camera.height):
            return None
        settings = _pick_settings(self._context.scene)
        return pick(_renderer(self._context, settings.method), self._scene, self._camera, column, row, settings)

    def radius_at(self, point: npt.NDArray[np.float64], pixels: float) -> float:
        """World units that so many pixels are at a point's depth."""
        depth = (self._camera.camera_from_world @ np.append(point, 1.0))[2]
        return float(pixels / self._camera.fx * (depth if self._camera.projection == "pinhole" else 1.0))


def _pick_settings(b_scene: Any) -> Settings:
    """As *rays* where those are on the screen, for they show others inside a capture; as *sorted* elsewhere.

    Where rays are on the screen their kernels are loaded; scripts in the background wait for them.
    """
    settings = sync.viewport_settings(b_scene)
    if settings.method == "rays" and (bpy.app.background or residency.is_prepared(settings.device, "rays")):
        return replace(settings, storage="full")  # so that splats are numbered as in the host's memory
    return Settings(method="sorted")


def _renderer(context: Any, method: str) -> Renderer:
    """The renderer for looks into the scene; viewports go on beside it."""
    device = sync.DEVICE[context.scene.stipple.device]
    editing_device(device, part=method)
    if device not in _renderers:
        free()
        from ...engine.renderer import Renderer

        _renderers[device] = Renderer(device)
    return _renderers[device]


def free() -> None:
    while _renderers:
        _renderers.popitem()[1].free()


register, unregister = kept_for_file(free)
