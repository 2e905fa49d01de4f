# SPDX-License-Identifier: GPL-3.0-or-later
"""The engine's camera against Blender's own projection."""

from __future__ import annotations

import itertools
from typing import Any

import bpy
import numpy as np
import pytest
from bpy_extras.object_utils import world_to_camera_view
from mathutils import Vector

from stipple.addon.camera import border_window, camera_from_blender, frame_size
from stipple.engine.camera import Camera
from stipple.engine.errors import StippleError

from .captures import add_camera

pytestmark = pytest.mark.blender

SIZES = ((640, 480, 100), (480, 640, 100), (600, 600, 50), (1920, 1080, 25))
ASPECTS = ((1.0, 1.0), (2.0, 1.0), (1.0, 1.5))
SHIFTS = ((0.0, 0.0), (0.21, -0.13))


def points_in_view(b_camera: Any, count: int = 40) -> np.ndarray:
    """World points in front of the camera, some outside its frame."""
    rng = np.random.default_rng(3)
    depth = rng.uniform(1, 20, count)
    local = np.stack([rng.uniform(-0.6, 0.6, count) * depth, rng.uniform(-0.6, 0.6, count) * depth, -depth], axis=1)
    matrix = np.array(b_camera.matrix_world.normalized())
    return local @ matrix[:3, :3].T + matrix[:3, 3]


def evaluated_camera() -> tuple[Any, Camera]:
    b_depsgraph = bpy.context.evaluated_depsgraph_get()
    b_scene = bpy.context.scene
    b_camera = b_scene.camera.evaluated_get(b_depsgraph)
    return b_camera, camera_from_blender(b_camera, b_scene.render)


def assert_projects_like_blender() -> None:
    b_camera, camera = evaluated_camera()
    points = points_in_view(b_camera)
    views = np.array([world_to_camera_view(bpy.context.scene, b_camera, Vector(point)) for point in points])
    expected = np.stack([views[:, 0] * camera.width, (1 - views[:, 1]) * camera.height, views[:, 2]], axis=1)
    projected = camera.project(points)
    # Blender's own function works in float32: far outside the frame its rounding alone passes a thousandth.
    near_frame = (np.abs(expected[:, :2]) < 2 * max(camera.width, camera.height)).all(axis=1)
    assert near_frame.sum() > 20
    assert np.abs(projected - expected)[near_frame, :2].max() < 1e-3
    np.testing.assert_allclose(projected[:, 2], expected[:, 2], rtol=1e-5)


@pytest.mark.parametrize("kind", ["PERSP", "ORTHO"])
@pytest.mark.parametrize("fit", ["AUTO", "HORIZONTAL", "VERTICAL"])
@pytest.mark.parametrize("size", SIZES)
def test_agrees_with_world_to_camera_view(kind: str, fit: str, size: tuple[int, int, int]) -> None:
    b_object = add_camera((0.3, -4.0, 0.7))
    b_object.rotation_euler = (1.3, 0.2, -0.4)
    b_camera, b_render = b_object.data, bpy.context.scene.render
    b_camera.type, b_camera.sensor_fit = kind, fit
    b_camera.lens, b_camera.sensor_width, b_camera.sensor_height = 35.0, 32.0, 18.0
    b_camera.ortho_scale = 7.5
    b_render.resolution_x, b_render.resolution_y, b_render.resolution_percentage = size
    for aspect, shift in itertools.product(ASPECTS, SHIFTS):
        b_render.pixel_aspect_x, b_render.pixel_aspect_y = aspect
        b_camera.shift_x, b_camera.shift_y = shift
        assert_projects_like_blender()


@pytest.mark.parametrize("kind", ["PERSP", "ORTHO"])
def test_agrees_with_the_render_matrix_at_an_odd_percentage(kind: str) -> None:
    """Where the percentage cuts pixels off, world_to_camera_view ignores it and the renders do not."""
    b_object = add_camera()
    b_object.data.type, b_object.data.shift_x, b_object.data.shift_y = kind, 0.1, 0.2
    b_render = bpy.context.scene.render
    b_render.resolution_x, b_render.resolution_y, b_render.resolution_percentage = 1001, 667, 33
    b_render.pixel_aspect_y = 1.25
    b_camera, camera = evaluated_camera()
    assert (camera.width, camera.height) == (330, 220)
    matrix = np.array(
        b_camera.calc_matrix_camera(bpy.context.evaluated_depsgraph_get(), x=330, y=220, scale_x=1.0, scale_y=1.25)
    ) @ np.array(b_camera.matrix_world.inverted())
    points = points_in_view(b_camera)
    clip = np.hstack([points, np.ones((len(points), 1))]) @ matrix.T
    ndc = clip[:, :2] / clip[:, 3:]
    expected = np.stack([(ndc[:, 0] + 1) / 2 * 330, (1 - ndc[:, 1]) / 2 * 220], axis=1)
    np.testing.assert_allclose(camera.project(points)[:, :2], expected, atol=1e-3)


@pytest.mark.parametrize("scale", [(2.0, 2.0, 2.0), (0.5, 3.0, 1.5), (-1.0, 1.0, 1.0)])
def test_scale_of_parents_does_not_count(scale: tuple[float, float, float]) -> None:
    b_object = add_camera((0.2, -2.0, 0.1))
    b_parent = bpy.data.objects.new("Parent", None)
    bpy.context.scene.collection.objects.link(b_parent)
    b_parent.scale, b_parent.location, b_parent.rotation_euler = scale, (1.0, 2.0, 3.0), (0.0, 0.0, 0.9)
    b_object.parent = b_parent
    assert_projects_like_blender()


def test_clipping_and_projection_come_from_the_camera() -> None:
    b_object = add_camera()
    b_object.data.clip_start, b_object.data.clip_end = 0.25, 40.0
    _, camera = evaluated_camera()
    assert (camera.near, camera.far, camera.projection, camera.window) == (0.25, 40.0, "pinhole", None)
    b_object.data.type = "ORTHO"
    assert evaluated_camera()[1].projection == "orthographic"


def test_animated_camera_follows_the_frame() -> None:
    b_object = add_camera()
    for frame, x in ((1, 0.0), (11, 10.0)):
        b_object.location.x = x
        b_object.keyframe_insert("location", frame=frame)
    xs = []
    for frame in (1, 11):
        bpy.context.scene.frame_set(frame)
        xs.append(evaluated_camera()[1].position[0])
    np.testing.assert_allclose(xs, (0, 10), atol=1e-6)


@pytest.mark.parametrize("crop", [False, True])
def test_border_window_counts_rows_from_the_top(crop: bool) -> None:
    b_render = bpy.context.scene.render
    b_render.resolution_x, b_render.resolution_y, b_render.resolution_percentage = 200, 100, 50
    b_render.use_border, b_render.use_crop_to_border = True, crop
    b_render.border_min_x, b_render.border_max_x = 0.1, 0.5
    b_render.border_min_y, b_render.border_max_y = 0.2, 0.9
    assert frame_size(b_render) == (100, 50)
    assert border_window(b_render) == (10, 5, 40, 35)
    b_render.use_border = False
    assert border_window(b_render) is None


def test_an_empty_border_is_an_error() -> None:
    b_render = bpy.context.scene.render
    b_render.use_border = True
    b_render.border_min_x, b_render.border_max_x = 0.5, 0.5
    with pytest.raises(StippleError, match="region holds no pixel"):
        border_window(b_render)


def test_a_panoramic_camera_is_an_error() -> None:
    b_object = add_camera()
    b_object.data.type = "PANO"
    with pytest.raises(StippleError, match=r"Camera: Stipple cannot render pano cameras; set Lens > Type"):
        evaluated_camera()


def test_a_flattened_camera_is_an_error() -> None:
    b_object = add_camera()
    b_object.scale = (1.0, 0.0, 1.0)
    with pytest.raises(StippleError, match="scale is zero"):
        evaluated_camera()
