# SPDX-License-Identifier: GPL-3.0-or-later
"""A Blender camera and the render's frame as an engine Camera.

Blender's camera looks along its −z with y up; the engine's along +z with y down (OpenCV). Intrinsics follow Blender's
own camera parameters in float64: sensor fit, shift and pixel aspect as its renderers see them.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from ..engine.camera import Camera
from ..engine.errors import StippleError

OPENCV_FROM_BLENDER = np.diag([1.0, -1.0, -1.0])


def frame_size(b_render: Any) -> tuple[int, int]:
    """Width and height of the whole frame [px]: resolution × percentage, cut to whole pixels as Blender does."""
    width = b_render.resolution_x * b_render.resolution_percentage // 100
    height = b_render.resolution_y * b_render.resolution_percentage // 100
    return max(width, 1), max(height, 1)


def border_window(b_render: Any) -> tuple[int, int, int, int] | None:
    """The render border as (x, y, width, height) [px, from the top left]; None when the whole frame is rendered.

    With and without *Crop to Render Region* the same pixels are rendered: Blender itself puts them into the frame.
    Products are rounded down in float32, as Blender does, so the size is the one its RenderResult has. Raises
    StippleError when no pixel is inside.
    """
    if not b_render.use_border:
        return None
    width, height = frame_size(b_render)
    left, right = _pixels(b_render.border_min_x, width), _pixels(b_render.border_max_x, width)
    bottom, top = _pixels(b_render.border_min_y, height), _pixels(b_render.border_max_y, height)
    if right <= left or top <= bottom:
        raise StippleError("The render region holds no pixel; draw a larger one or turn off Render Region.")
    return left, height - top, right - left, top - bottom


def camera_from_blender(
    b_camera_object: Any,
    b_render: Any,
    world_from_camera: npt.ArrayLike | None = None,
    shift_x: float | None = None,
) -> Camera:
    """The engine's camera for an evaluated camera object and the frame it is rendered in.

    `world_from_camera` (4, 4) and `shift_x` replace the object's own matrix and shift: stereo views differ in both.
    Scale of the object or its parents is taken out axis by axis, as Blender does; what shear is left makes
    `camera_from_world` other than a rotation. Does not model depth of field or lens distortion.

    Raises StippleError for a panoramic camera, and for an object that is not a camera.
    """
    if b_camera_object.type != "CAMERA":
        raise StippleError(f"{b_camera_object.name} is not a camera; choose one in Scene properties > Camera.")
    check_lens(b_camera_object)
    b_camera = b_camera_object.data
    width, height = frame_size(b_render)
    aspect = b_render.pixel_aspect_y / b_render.pixel_aspect_x
    fit_px, sensor_mm = _fit(b_camera, width, height, b_render.pixel_aspect_x, b_render.pixel_aspect_y)
    orthographic = b_camera.type == "ORTHO"
    if orthographic and b_camera.ortho_scale <= 0:
        raise StippleError(f"{b_camera_object.name}: its Orthographic Scale is 0; give it a size.")
    fx = fit_px / b_camera.ortho_scale if orthographic else fit_px * b_camera.lens / sensor_mm
    matrix = b_camera_object.matrix_world if world_from_camera is None else world_from_camera
    return Camera(
        camera_from_world=camera_from_world(matrix, b_camera_object.name),
        width=width,
        height=height,
        fx=fx,
        fy=fx / aspect,
        cx=width / 2 - (b_camera.shift_x if shift_x is None else shift_x) * fit_px,
        cy=height / 2 + b_camera.shift_y * fit_px / aspect,
        near=b_camera.clip_start,
        far=b_camera.clip_end,
        projection="orthographic" if orthographic else "pinhole",
        window=border_window(b_render),
    )


def check_lens(b_camera_object: Any) -> None:
    """Raises StippleError for a panoramic camera, whose picture no matrix makes, and for one of custom shaders."""
    kind = b_camera_object.data.type
    if kind not in ("PERSP", "ORTHO"):
        raise StippleError(
            f"{b_camera_object.name}: Stipple cannot render {kind.lower()} cameras; "
            f"set Lens > Type to Perspective or Orthographic."
        )


def _fit(b_camera: Any, width: int, height: int, aspect_x: float, aspect_y: float) -> tuple[float, float]:
    """Length of the fitted side of the frame [px of width] and of the sensor [mm].

    AUTO fits the longer side of the picture, pixel aspect included, but always measures the sensor's width.
    """
    horizontal = b_camera.sensor_fit == "HORIZONTAL"
    if b_camera.sensor_fit == "AUTO":
        horizontal = aspect_x * width >= aspect_y * height
    fit_px = width if horizontal else height * aspect_y / aspect_x
    return fit_px, b_camera.sensor_height if b_camera.sensor_fit == "VERTICAL" else b_camera.sensor_width


def camera_from_world(matrix: npt.ArrayLike, name: str) -> npt.NDArray[np.float64]:
    """The engine's (3, 4) `camera_from_world` of a camera object's matrix, its scale taken out axis by axis.

    Raises StippleError where an axis has no length or the axes are flattened.
    """
    world_from_camera = np.array(matrix, dtype=np.float64)
    length = np.linalg.norm(world_from_camera[:3, :3], axis=0)
    if not np.isfinite(world_from_camera).all() or not (length > 0).all():
        raise StippleError(f"{name}: the camera's scale is zero along an axis; give it and its parents a scale.")
    axes = world_from_camera[:3, :3] / length
    try:
        linear = OPENCV_FROM_BLENDER @ np.linalg.inv(axes)
    except np.linalg.LinAlgError:
        raise StippleError(f"{name}: the camera's axes are flattened by its parents' scale; unparent it.") from None
    return np.hstack([linear, -linear @ world_from_camera[:3, 3:]])


def _pixels(fraction: float, size: int) -> int:
    return int(np.float32(fraction) * np.float32(size))
