# SPDX-License-Identifier: GPL-3.0-or-later
"""bpy.ops.import_scene.splat_cameras: cameras that see what the file's cameras see, on the capture's axes."""

from __future__ import annotations

import itertools
import json
from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest
from mathutils import Euler, Matrix

from stipple.addon.camera import camera_from_blender
from stipple.addon.camera_animation import curves_of
from stipple.engine.formats.cameras_file import read_cameras
from tests.colmap_files import Lens, view_of, write_binary

from .camera_models import cameras_around, error_px, import_cameras, messages, set_size, write_model
from .captures import add_camera, add_capture, random_cloud

pytestmark = pytest.mark.blender

UPRIGHT = np.array(Matrix.Rotation(-np.pi / 2, 4, "X"))


def placed_capture(scale: tuple[float, float, float] = (1.7, 1.7, 1.7)) -> Any:
    """An active, transformed capture."""
    b_object = add_capture(random_cloud())
    b_object.location, b_object.rotation_euler, b_object.scale = (3.0, -2.0, 1.0), Euler((0.5, -1.1, 2.0)), scale
    b_object.select_set(True)
    bpy.context.view_layer.objects.active = b_object
    return b_object


def test_cameras_see_what_the_files_cameras_see(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    """Around a moved, turned, scaled capture, with the principal point off the centre."""
    b_capture = placed_capture()
    set_size()
    b_objects = import_cameras(write_model(tmp_path / "garden" / "sparse" / "0"))
    cameras = cameras_around()
    assert [b_object.name for b_object in b_objects] == [f"frame_{index + 7:04d}" for index in range(12)]
    assert "garden" in bpy.data.collections
    for b_object, camera in zip(b_objects, cameras, strict=True):
        assert error_px(b_object, camera, np.array(b_capture.matrix_world)) < 1e-3
        np.testing.assert_allclose(b_object.scale, (1, 1, 1), atol=1e-6)
        assert b_object.data.clip_start == pytest.approx(1.7 * camera.near)
        assert 0.2 < b_object.data.display_size < 1.0  # the ring is 17 units wide
    assert bpy.context.scene.camera == b_objects[0]
    assert bpy.context.view_layer.objects.active == b_capture  # another file of the same capture can follow
    assert messages(capfd, "Warning") == []


def test_without_a_capture_the_up_axis_counts(tmp_path: Path) -> None:
    set_size()
    path = write_model(tmp_path / "model", count=3)
    b_mesh = bpy.data.objects.new("Mesh", bpy.data.meshes.new("Mesh"))
    bpy.context.scene.collection.objects.link(b_mesh)
    bpy.context.view_layer.objects.active = b_mesh
    b_objects = import_cameras(path)
    assert error_px(b_objects[1], cameras_around(count=3)[1], UPRIGHT) < 1e-3
    bpy.data.batch_remove([*b_objects, *bpy.data.collections])
    placed_capture()
    b_objects = import_cameras(path, match_active=False, up_axis="Z")
    assert error_px(b_objects[1], cameras_around(count=3)[1], np.eye(4)) < 1e-3


def test_a_selected_capture_counts_where_the_active_object_is_none(tmp_path: Path) -> None:
    set_size()
    b_capture = placed_capture()
    bpy.context.view_layer.objects.active = add_camera()
    b_objects = import_cameras(write_model(tmp_path / "model", count=2))
    assert error_px(b_objects[0], cameras_around(count=2)[0], np.array(b_capture.matrix_world)) < 1e-3


def test_uneven_scale_is_said(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    b_capture = placed_capture(scale=(1.0, 2.0, 1.0))
    set_size()
    (b_object, _) = import_cameras(write_model(tmp_path / "model", count=2))
    (warning,) = messages(capfd, "Warning")
    assert "scaled unevenly" in warning
    camera = cameras_around(count=2)[0]
    middle = np.array(b_capture.matrix_world) @ [0.1, 0.2, 0.3, 1]  # what it looks at stays where it is
    seen = camera_from_blender(b_object, bpy.context.scene.render).project(middle[:3])
    np.testing.assert_allclose(seen[0, :2], camera.project((0.1, 0.2, 0.3))[0, :2], atol=1e-2)
    bpy.ops.ed.undo_push(message="x")
    b_capture.scale = (0.0, 1.0, 1.0)
    with pytest.raises(RuntimeError, match="scale is zero along an axis"):
        bpy.ops.import_scene.splat_cameras(filepath=str(tmp_path / "model"))


@pytest.mark.parametrize("fy", [480.0, 560.0])
def test_pixel_aspect(tmp_path: Path, fy: float, capfd: pytest.CaptureFixture[str]) -> None:
    """Left alone with a warning; set with the resolution, as all views agree; then everything is exact."""
    lens = Lens(1, "PINHOLE", 640, 480, (520.0, fy, 341.5, 222.25))
    path, b_render = write_model(tmp_path / "model", lens, count=3), bpy.context.scene.render
    set_size()
    b_objects = import_cameras(path, up_axis="Z")
    assert (b_render.pixel_aspect_x, b_render.pixel_aspect_y) == (1, 1)
    (warning,) = messages(capfd, "Warning")
    assert "fx / fy is not the scene's pixel aspect" in warning and f"{520 / fy:.6g}" in warning
    seen = camera_from_blender(b_objects[0], b_render)
    np.testing.assert_allclose([seen.fx, seen.fy, seen.cx, seen.cy], [520, 520, 341.5, 222.25], rtol=1e-6)
    bpy.data.batch_remove([*b_objects, *bpy.data.collections])
    b_render.resolution_x, b_render.resolution_percentage = 1920, 50
    b_objects = import_cameras(path, up_axis="Z", set_resolution=True)
    assert messages(capfd, "Warning") == []
    assert b_render.pixel_aspect_y / b_render.pixel_aspect_x == pytest.approx(520 / fy, rel=1e-6)
    for b_object, camera in zip(b_objects, cameras_around(lens, 3), strict=True):
        assert error_px(b_object, camera, np.eye(4)) < 1e-3


def test_views_that_disagree_leave_the_pixel_aspect(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    lenses = [Lens(1, "PINHOLE", 640, 480, (500, 500, 320, 240)), Lens(2, "PINHOLE", 320, 480, (500, 600, 160, 240))]
    views = [view_of(index, cameras_around()[index], f"{index}", lens.id) for index, lens in enumerate(lenses)]
    (b_object,) = import_cameras(write_binary(tmp_path / "model", lenses, views), as_animation=True)
    b_render = bpy.context.scene.render
    assert (b_render.resolution_x, b_render.resolution_y, b_render.pixel_aspect_y) == (640, 480, 1)
    warnings = messages(capfd, "Warning")
    assert len(warnings) == 2 and "fx / fy is not the scene's pixel aspect" in warnings[0] and "2 sizes" in warnings[1]
    assert b_object.data.lens == pytest.approx(500 / 640 * 36)


def test_the_scene_keeps_its_resolution(tmp_path: Path) -> None:
    set_size(1920, 1080)
    import_cameras(write_model(tmp_path / "model", count=2))
    b_scene = bpy.context.scene
    assert (b_scene.render.resolution_x, b_scene.render.resolution_y) == (1920, 1080)
    assert (b_scene.frame_start, b_scene.frame_end) == (1, 250)


def test_one_animated_camera(tmp_path: Path) -> None:
    """Twice around in 12 frames, from the scene's first frame: every frame exact, quaternions never jump."""
    b_capture, b_scene = placed_capture(), bpy.context.scene
    set_size(1920, 1080)
    b_scene.frame_start = 21
    (b_object,) = import_cameras(write_model(tmp_path / "model"), as_animation=True)
    assert (b_scene.frame_start, b_scene.frame_end, b_scene.camera) == (21, 32, b_object)
    assert (b_scene.render.resolution_x, b_scene.render.resolution_y) == (640, 480)
    quaternions = []
    for index, camera in enumerate(cameras_around()):
        b_scene.frame_set(21 + index)
        assert error_px(b_object, camera, np.array(b_capture.matrix_world)) < 1e-3
        quaternions.append(np.array(b_object.rotation_quaternion))
    assert all(left @ right > 0 for left, right in itertools.pairwise(quaternions))
    curves = [*curves_of(b_object), *curves_of(b_object.data)]
    assert len(curves) == 3 + 4 + 3
    for b_curve in curves:
        assert [int(b_key.co[0]) for b_key in b_curve.keyframe_points] == list(range(21, 33))
        assert {b_key.interpolation for b_key in b_curve.keyframe_points} == {"LINEAR"}


def test_zoom_is_animated(tmp_path: Path) -> None:
    lenses = [Lens(number, "PINHOLE", 640, 480, (200.0 * number,) * 2 + (300.0, 250.0)) for number in (1, 2)]
    cameras = [cameras_around(lens)[index] for index, lens in enumerate(lenses)]
    views = [view_of(index, camera, f"{index}", index + 1) for index, camera in enumerate(cameras)]
    (b_object,) = import_cameras(write_binary(tmp_path / "model", lenses, views), as_animation=True, up_axis="Z")
    for frame, camera in enumerate(cameras, start=1):
        bpy.context.scene.frame_set(frame)
        assert error_px(b_object, camera, np.eye(4)) < 1e-3


def test_names_come_from_images(tmp_path: Path) -> None:
    entry = {"width": 64, "height": 48, "fx": 50, "fy": 50, "position": [0, 0, 0], "rotation": np.eye(3).tolist()}
    path = tmp_path / "views.of.garden.json"
    path.write_text(
        json.dumps([entry | {"img_name": "left/IMG_1.JPG"}, entry | {"img_name": "right/IMG_1.JPG"}, entry])
    )
    assert [b_object.name for b_object in import_cameras(path)] == ["IMG_1", "IMG_1.001", "2"]
    assert "views.of.garden" in bpy.data.collections


def test_folders_as_the_file_browser_gives_them(tmp_path: Path) -> None:
    folder = write_model(tmp_path / "garden", count=2)
    assert bpy.ops.import_scene.splat_cameras(directory=f"{folder}/") == {"FINISHED"}
    assert bpy.ops.import_scene.splat_cameras(filepath=f"{folder}/") == {"FINISHED"}
    assert bpy.ops.import_scene.splat_cameras(filepath=str(folder / "images.bin")) == {"FINISHED"}
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "scene.blend"))
    assert bpy.ops.import_scene.splat_cameras(filepath="//garden") == {"FINISHED"}
    assert len(bpy.data.cameras) == 8


def test_undo_and_redo(tmp_path: Path) -> None:
    bpy.ops.ed.undo_push(message="Before")
    import_cameras(write_model(tmp_path / "model", count=3), as_animation=True)
    bpy.ops.ed.undo_push(message="Imported")
    bpy.ops.ed.undo()
    assert len(bpy.data.collections) == len(bpy.data.cameras) == 0 and bpy.context.scene.frame_end == 250
    bpy.ops.ed.redo()
    assert len(bpy.data.collections) == 1 and bpy.context.scene.frame_end == 3


@pytest.mark.real
@pytest.mark.parametrize("name", ["koala", "rubber_toy_cloud"])
def test_real_captures(shared_data: Path, name: str) -> None:
    set_size()
    bpy.ops.import_scene.splats(filepath=str(shared_data / "real" / f"{name}.ply"))
    path = shared_data / "real" / f"{name}_cameras.json"
    b_objects = import_cameras(path)
    world_from_capture = np.array(bpy.context.view_layer.objects.active.matrix_world)
    for b_object, camera in zip(b_objects, read_cameras(path), strict=True):
        assert error_px(b_object, camera, world_from_capture) < 1e-3
