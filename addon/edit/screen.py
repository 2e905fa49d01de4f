# SPDX-License-Identifier: GPL-3.0-or-later
"""The view that a screen-space edit is made in: the region it was called from, or a camera that the caller names."""

from __future__ import annotations

from typing import Any

import numpy as np

from ...engine.camera import Camera
from ...engine.errors import StippleError
from ...engine.look import Look
from .. import world
from ..camera import camera_from_blender
from ..looks import LookReader
from ..view_camera import view_of
from .mode import edited_object


def camera_of(context: Any, name: str) -> Camera:
    """The engine's camera of the region, or of the camera object called `name` at the scene's resolution.

    Raises StippleError where there is neither, or the camera has no picture.
    """
    if name:
        b_camera = context.scene.objects.get(name)
        if b_camera is None or b_camera.type != "CAMERA":
            raise StippleError(f"{name}: this scene has no camera of that name; choose one that it has.")
        return camera_from_blender(b_camera, context.scene.render)
    if context.region is None or getattr(context, "region_data", None) is None:
        raise StippleError("Edit Splats: there is no view here; work in a 3D viewport or name a camera.")
    return view_of(context, context.scene).camera()


def look_in(context: Any) -> Look:
    """How the edited capture is shown: what its crops take away is not there to be selected."""
    return LookReader(context.evaluated_depsgraph_get(), world.working_space()).look_of_object(edited_object(context))


def from_top(camera: Camera, points: Any) -> np.ndarray:
    """Blender's pixels, counted from the bottom left (…, 2), as the engine's, from the top left."""
    points = np.asarray(points, np.float64)
    return np.stack([points[..., 0], camera.height - points[..., 1]], axis=-1)
