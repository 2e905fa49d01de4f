# SPDX-License-Identifier: GPL-3.0-or-later
"""An engine Camera as a Blender camera: the inverse of `camera`.

Blender knows one focal length per camera. That pixels are seen wider than high, or higher than wide (fx ≠ fy), is the
pixel aspect of the scene.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import bpy
import numpy as np
import numpy.typing as npt
from mathutils import Matrix

from ..engine.camera import Camera
from .camera import OPENCV_FROM_BLENDER

ASPECT_TOLERANCE = 1e-6  # relative; Blender stores the pixel aspect in float32
SCALE_TOLERANCE = 1e-4  # relative; matrices of objects are float32
DISPLAY_SIZE = 0.03  # of the diagonal of the box around all cameras
CLIP_END = 1e4  # as far as a capture's sky may be [capture's units]; farther costs the viewport depth precision


def view_aspect(camera: Camera) -> float:
    """fx / fy: what Blender's pixel_aspect_y / pixel_aspect_x has to be for this view."""
    return 1.0 if abs(camera.fx / camera.fy - 1) < ASPECT_TOLERANCE else camera.fx / camera.fy


def scene_aspect(b_render: Any) -> float:
    """pixel_aspect_y / pixel_aspect_x."""
    return float(b_render.pixel_aspect_y / b_render.pixel_aspect_x)


def set_frame(b_render: Any, camera: Camera, aspect: float) -> None:
    """Makes the render's frame the view's size [px] at 100 %, with this pixel aspect (y / x)."""
    b_render.resolution_x, b_render.resolution_y = camera.width, camera.height
    b_render.resolution_percentage = 100
    b_render.pixel_aspect_x, b_render.pixel_aspect_y = max(1 / aspect, 1.0), max(aspect, 1.0)  # Blender wants 1 to 200


def set_lens(b_camera: Any, camera: Camera, aspect: float) -> None:
    """Focal length and shifts on a camera datablock, for a frame of the view's shape and this pixel aspect.

    `camera_from_blender` then gives fx, cx and cy back, and fy where `aspect` is the view's. Fits the width of the
    frame: in a frame of another shape the picture keeps its width and shows more or less above and below.
    """
    b_camera.lens = camera.fx / camera.width * b_camera.sensor_width
    b_camera.shift_x = (camera.width / 2 - camera.cx) / camera.width
    b_camera.shift_y = (camera.cy - camera.height / 2) * aspect / camera.width


def new_camera_data(name: str, camera: Camera, aspect: float, world_scale: float, display_size: float) -> Any:
    """A camera datablock with the view's lens; clipping distances follow the scale of the capture in the world."""
    b_camera = bpy.data.cameras.new(name)
    b_camera.type, b_camera.sensor_fit = "PERSP", "HORIZONTAL"
    b_camera.clip_start, b_camera.clip_end = camera.near * world_scale, min(camera.far, CLIP_END) * world_scale
    b_camera.display_size = display_size
    set_lens(b_camera, camera, aspect)
    return b_camera


def display_size_of(world_from_cameras: Sequence[Matrix]) -> float:
    """How large to draw the cameras [world units], so that hundreds around a capture leave it visible."""
    places = np.array([matrix.translation for matrix in world_from_cameras])
    diagonal = float(np.linalg.norm(np.ptp(places, axis=0)))
    return DISPLAY_SIZE * diagonal if diagonal > 0 else 1.0


def world_from_blender_camera(world_from_capture: npt.NDArray[np.float64], camera: Camera) -> Matrix:
    """Where a Blender camera stands and looks that sees the capture as `camera` does: a rotation and a translation.

    An even scale of the capture moves the camera and changes nothing else in its picture. Cameras cannot follow an
    uneven scale, shear or mirror (see `is_similarity`): then the view direction and the place are right.
    """
    linear = world_from_capture[:3, :3] @ camera.camera_from_world[:, :3].T @ OPENCV_FROM_BLENDER
    backward = linear[:, 2] / np.linalg.norm(linear[:, 2])
    right = np.cross(linear[:, 1], backward)
    right /= np.linalg.norm(right)
    world_from_camera = np.eye(4)
    world_from_camera[:3, :3] = np.stack([right, np.cross(backward, right), backward], axis=1)
    world_from_camera[:3, 3] = world_from_capture[:3, :3] @ camera.position + world_from_capture[:3, 3]
    return Matrix(world_from_camera.tolist())


def scale_of(world_from_capture: npt.NDArray[np.float64]) -> float:
    """World units per unit of the capture; the mean where axes differ, 0 where the capture is flat."""
    return float(abs(np.linalg.det(world_from_capture[:3, :3])) ** (1 / 3))


def is_similarity(world_from_capture: npt.NDArray[np.float64]) -> bool:
    """Whether the matrix is a rotation with an even scale, so that cameras can follow it exactly."""
    linear = world_from_capture[:3, :3] / scale_of(world_from_capture)
    return bool(np.linalg.det(linear) > 0 and np.abs(linear @ linear.T - np.eye(3)).max() < SCALE_TOLERANCE)
