# SPDX-License-Identifier: GPL-3.0-or-later
"""Frames rendered by Blender with the engine: files, passes, animation, regions, view layers, stereo."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest

from stipple.addon import output, residency
from stipple.addon.camera import camera_from_blender
from stipple.engine.colour import scene_linear_from_display
from stipple.engine.renderer import Renderer
from stipple.engine.scene import Instance, Scene
from stipple.engine.settings import Settings
from stipple.engine.splats import SplatCloud

from .captures import add_camera, add_capture, pixels_of, random_cloud, render, render_channel, use_stipple

pytestmark = pytest.mark.blender


def engine_picture(cloud: SplatCloud, b_object: Any, background: tuple[float, float, float] | None) -> np.ndarray:
    """The same frame from the engine alone: premultiplied sRGB-encoded."""
    b_scene = bpy.context.scene
    camera = camera_from_blender(b_scene.camera, b_scene.render)
    scene = Scene((Instance(cloud, np.array(b_object.matrix_world, dtype=np.float64)[:3]),), background)
    return Renderer("cpu").render(scene, camera, Settings(method="sorted", device="cpu")).rgba


def test_png_equals_the_engines_picture(tmp_path: Path) -> None:
    """F12 with the view transform Standard shows what the capture was trained for."""
    use_stipple()
    add_camera()
    cloud = random_cloud()
    b_object = add_capture(cloud)
    rendered = render(tmp_path / "frame.png")
    expected = np.clip(engine_picture(cloud, b_object, (0.0, 0.0, 0.0)), 0, 1)
    assert expected[..., :3].std() > 0.05
    assert np.abs(np.rint(rendered * 255) - expected * 255).max() <= 1


def test_exr_holds_scene_linear_premultiplied_light_and_depth(tmp_path: Path) -> None:
    b_scene = use_stipple()
    b_scene.render.film_transparent = True
    add_camera()
    cloud = random_cloud()
    b_object = add_capture(cloud)
    rendered = render(tmp_path / "frame.exr")
    expected = scene_linear_from_display(engine_picture(cloud, b_object, None))
    assert expected[..., 3].min() == 0 and expected[..., 3].max() > 0.9
    np.testing.assert_allclose(rendered, expected, atol=1e-6)


def test_depth_pass(tmp_path: Path) -> None:
    use_stipple()
    add_camera((0.0, -4.0, 0.0))
    cloud = random_cloud(1, 0, size=0.3)
    cloud.position[0] = 0
    add_capture(cloud)
    bpy.context.view_layer.use_pass_z = True
    depth = render_channel(tmp_path / "frame.exr", "ViewLayer.Depth.Z")
    assert depth[0, 0] == np.float32(1e10)
    assert depth[24, 32] == pytest.approx(4.0, abs=1e-4)


def test_strips_of_any_height_make_the_same_frame(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The picture is handed over in strips; 48 rows in one, in strips of 7 with a last one of 6, and row by row."""
    use_stipple().render.film_transparent = True
    add_camera()
    add_capture(random_cloud())
    bpy.context.view_layer.use_pass_z = True
    frames = []
    for row_count in (48, 7, 1):
        monkeypatch.setattr(output, "STRIP_BYTES", row_count * 64 * 16)
        path = tmp_path / f"{row_count}.exr"
        frames.append([render_channel(path, f"ViewLayer.{name}") for name in ("Combined.R", "Combined.A", "Depth.Z")])
    assert all(len(np.unique(channel)) > 100 for channel in frames[0])
    for frame in frames[1:]:
        for channel, whole in zip(frame, frames[0], strict=True):
            assert np.array_equal(channel, whole)


def test_film_transparent_and_world_colour(tmp_path: Path) -> None:
    b_scene = use_stipple()
    add_camera()
    add_capture(random_cloud(20))
    b_scene.world = bpy.data.worlds.new("World")
    if bpy.app.version < (5, 0, 0):
        b_scene.world.use_nodes = True
    b_node = next((b_node for b_node in b_scene.world.node_tree.nodes if b_node.type == "BACKGROUND"), None)
    if b_node is None:
        b_node = b_scene.world.node_tree.nodes.new("ShaderNodeBackground")
        b_output = b_scene.world.node_tree.nodes.new("ShaderNodeOutputWorld")
        b_scene.world.node_tree.links.new(b_node.outputs[0], b_output.inputs["Surface"])
    b_node.inputs["Color"].default_value = (0.2, 0.4, 0.6, 1.0)
    opaque = render(tmp_path / "opaque.exr")
    np.testing.assert_allclose(opaque[0, 0], (0.2, 0.4, 0.6, 1.0), atol=1e-5)
    b_scene.render.film_transparent = True
    transparent = render(tmp_path / "transparent.exr")
    np.testing.assert_array_equal(transparent[0, 0], (0, 0, 0, 0))
    assert transparent[..., 3].max() > 0.5


@pytest.mark.parametrize("method", ["SORTED", "POINTS"])
@pytest.mark.parametrize("crop", [False, True])
def test_a_region_is_cut_out_of_the_whole_frame(tmp_path: Path, method: str, crop: bool) -> None:
    b_scene = use_stipple(method=method)
    add_camera().data.shift_x = 0.05
    add_capture(random_cloud())
    whole = render(tmp_path / "whole.exr")
    b_render = b_scene.render
    b_render.use_border, b_render.use_crop_to_border = True, crop
    b_render.border_min_x, b_render.border_max_x = 0.25, 0.7
    b_render.border_min_y, b_render.border_max_y = 0.1, 0.8
    region = render(tmp_path / "region.exr")
    rows, columns = slice(48 - 38, 48 - 4), slice(16, 44)
    if not crop:
        assert region.shape == whole.shape
        outside = np.ones(whole.shape[:2], bool)
        outside[rows, columns] = False
        assert (region[outside] == 0).all()
        region = region[rows, columns]
    assert region.shape == whole[rows, columns].shape
    assert np.array_equal(region, whole[rows, columns])


def test_hidden_in_renders_and_other_view_layers(tmp_path: Path) -> None:
    use_stipple()
    add_camera()
    add_capture(random_cloud(seed=1), "One")
    alone = render(tmp_path / "alone.exr")
    b_two = add_capture(random_cloud(seed=2), "Two")
    both = render(tmp_path / "both.exr")
    assert np.abs(both - alone).max() > 0.1
    b_two.hide_render = True
    np.testing.assert_array_equal(render(tmp_path / "hidden.exr"), alone)
    b_two.hide_render = False
    b_collection = bpy.data.collections.new("Set")
    bpy.context.scene.collection.children.link(b_collection)
    b_collection.objects.link(b_two)
    bpy.context.scene.collection.objects.unlink(b_two)
    bpy.context.view_layer.layer_collection.children["Set"].exclude = True
    np.testing.assert_array_equal(render(tmp_path / "excluded.exr"), alone)


def animate(b_object: Any, b_camera: Any) -> None:
    for frame, x, turn, camera_z in ((1, -0.5, 0.0, 0.0), (10, 0.5, 1.0, 0.6)):
        b_object.location.x, b_object.rotation_euler.z, b_camera.location.z = x, turn, camera_z
        b_object.keyframe_insert("location", frame=frame)
        b_object.keyframe_insert("rotation_euler", frame=frame)
        b_camera.keyframe_insert("location", frame=frame)


@pytest.mark.parametrize("method", ["SORTED", "POINTS"])
def test_ten_frames_saved_reloaded_and_rendered_again_are_identical(tmp_path: Path, method: str) -> None:
    b_scene = use_stipple(method=method)
    animate(add_capture(random_cloud()), add_camera())
    b_scene.frame_start, b_scene.frame_end = 1, 10
    b_scene.render.image_settings.file_format = "PNG"

    def frames(folder: str) -> list[bytes]:
        bpy.context.scene.render.filepath = str(tmp_path / folder) + os.sep
        bpy.ops.render.render(animation=True)
        return [pixels_of(path).tobytes() for path in sorted((tmp_path / folder).glob("*.png"))]

    first = frames("first")
    assert len(first) == 10 and len(set(first)) == 10
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "scene.blend"))
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "scene.blend"))
    assert frames("second") == first


def test_an_unchanged_capture_is_uploaded_once(tmp_path: Path) -> None:
    use_stipple()
    b_object = add_capture(random_cloud())
    add_camera()
    render(tmp_path / "a.png")
    renderer = residency.renderer_for("cpu")
    held = {id(cloud) for cloud, _ in renderer._clouds.values()}
    b_object.location.x = 1
    render(tmp_path / "b.png")
    assert residency.renderer_for("cpu") is renderer
    assert {id(cloud) for cloud, _ in renderer._clouds.values()} == held


def test_nothing_to_render_says_so_and_shows_the_background(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    use_stipple().render.film_transparent = True
    add_camera()
    rendered = render(tmp_path / "empty.exr")
    assert (rendered == 0).all()
    printed = capfd.readouterr()
    assert "No capture is visible in the view layer 'ViewLayer'" in printed.out + printed.err


@pytest.mark.parametrize("multiview", [False, True])
def test_stereo_views_differ(tmp_path: Path, multiview: bool) -> None:
    b_scene = use_stipple()
    add_camera()
    add_capture(random_cloud())
    b_scene.render.use_multiview = multiview
    bpy.context.scene.render.image_settings.file_format = "PNG"
    bpy.context.scene.render.filepath = str(tmp_path / "eye.png")
    bpy.ops.render.render(write_still=True)
    pictures = [pixels_of(path) for path in sorted(tmp_path.glob("eye*.png"))]
    assert len(pictures) == 1 + multiview
    assert all(picture.max() > 0.1 for picture in pictures)
    if multiview:
        assert np.abs(pictures[0] - pictures[1]).max() > 0.1
