# SPDX-License-Identifier: GPL-3.0-or-later
"""The world behind the splats: its color, an environment image as Cycles shows it, and what is not shown."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest

from stipple.addon import residency, world
from stipple.addon.residency import CloudCache
from stipple.addon.sync import scene_from_depsgraph
from stipple.addon.world import background_of, working_space
from stipple.engine.colour import scene_linear_from_display
from stipple.engine.scene import Environment

from .captures import add_camera, add_capture, random_cloud, render, use_stipple
from .worlds import add_environment, add_world, cycles_picture, load_linear, new_image, save_exr, set_light, smooth_sky

pytestmark = pytest.mark.blender


def environment() -> Environment:
    background, notice = background_of(bpy.context.scene)
    assert isinstance(background, Environment) and notice == ""
    return background


def test_a_color_is_encoded_for_display() -> None:
    b_scene = bpy.context.scene
    b_scene.world = None
    assert background_of(b_scene) == ((0.0, 0.0, 0.0), "")
    add_world((0.107023, 0.0, 0.5), 2.0)  # half of 0.214046, which encodes to 0.5
    background, notice = background_of(b_scene)
    np.testing.assert_allclose(background, (0.5, 0.0, 1.0), atol=1e-5)
    assert notice == ""
    b_scene.render.film_transparent = True
    assert background_of(b_scene) == (None, "")


def test_working_space_is_the_files() -> None:
    assert working_space() == "Rec.709"
    if bpy.app.version >= (5, 0, 0):
        bpy.ops.wm.set_working_color_space(working_space="ACEScg")
        assert working_space() == "ACEScg"


@pytest.mark.parametrize("vector_type", ["POINT", "TEXTURE", "VECTOR", "NORMAL"])
@pytest.mark.parametrize("lens", ["PERSP", "ORTHO"])
def test_an_image_is_where_cycles_shows_it(tmp_path: Path, vector_type: str, lens: str) -> None:
    """Mapping, strength, camera; Cycles shares no code with us.

    Its image repeats downwards too, so that it mixes zenith and nadir in the last half row, where we do not: a few
    pixels.
    """
    use_stipple(64, 48)
    b_camera = add_camera()
    b_camera.data.type, b_camera.data.lens, b_camera.data.shift_x = lens, 12.0, 0.1
    b_camera.rotation_euler = (1.2, 0.3, 2.1)
    b_mapping = add_environment(new_image(smooth_sky()), 1.5)
    b_mapping.vector_type = vector_type
    b_mapping.inputs["Rotation"].default_value = (0.4, -0.3, 1.1)
    b_mapping.inputs["Scale"].default_value = (1.0, 0.8, 1.3)
    if "Location" in b_mapping.inputs:
        b_mapping.inputs["Location"].default_value = (0.1, -0.2, 0.15)
    ours, wanted = render(tmp_path / "ours.exr"), cycles_picture(tmp_path / "cycles.exr")
    assert wanted[..., :3].std() > (0.5 if lens == "PERSP" else 0.05)  # three channels of one color in orthographic
    differs = np.abs(ours / wanted - 1).max(axis=2) > 1e-4
    assert differs.sum() <= 4


def test_byte_images_and_files_are_linear_light(tmp_path: Path) -> None:
    """A PNG, as Cycles shows it; 8 bits in between."""
    use_stipple(64, 48)
    add_camera()
    b_saved = new_image(smooth_sky(1.0) ** (1 / 2.2), float_buffer=False)
    b_saved.filepath_raw, b_saved.file_format = str(tmp_path / "sky.png"), "PNG"
    b_saved.save()
    add_environment(bpy.data.images.load(str(tmp_path / "sky.png")))
    ours, wanted = render(tmp_path / "ours.exr"), cycles_picture(tmp_path / "cycles.exr")
    assert wanted[..., :3].std() > 0.1
    np.testing.assert_allclose(ours, wanted, atol=4e-3)


@pytest.mark.parametrize("space", ["Rec.709", "ACEScg"])
@pytest.mark.parametrize("method", ["SORTED", "POINTS"])
def test_uncovered_pixels_are_the_linear_image(tmp_path: Path, method: str, space: str) -> None:
    """HDR light in the file's own working space, behind a capture."""
    if space != "Rec.709":
        if bpy.app.version < (5, 0, 0):
            pytest.skip("before Blender 5 the working space is always Rec.709")
        bpy.ops.wm.set_working_color_space(working_space=space)
    b_scene = use_stipple(method=method)
    add_camera()
    add_capture(random_cloud(30))
    light = (0.003, 7.5, 41000.0)
    add_environment(new_image(np.broadcast_to(light, (8, 16, 3))))
    over = render(tmp_path / "over.exr")
    b_scene.render.film_transparent = True
    film = render(tmp_path / "film.exr")
    uncovered = film[..., 3] == 0
    assert 0.1 < uncovered.mean() < 0.99 and (film[~uncovered][:, :3] != over[~uncovered][:, :3]).any()
    np.testing.assert_allclose(
        over[uncovered], np.broadcast_to((*light, 1.0), over[uncovered].shape), rtol=2e-5, atol=0.02
    )
    np.testing.assert_allclose(over[uncovered][:, 2], light[2], rtol=2e-5)
    assert np.isfinite(over).all() and (film[uncovered] == 0).all()


def test_a_region_is_cut_out_of_the_whole_frame(tmp_path: Path) -> None:
    b_scene = use_stipple()
    add_camera()
    add_capture(random_cloud())
    add_environment(new_image(smooth_sky()))
    whole = render(tmp_path / "whole.exr")
    b_render = b_scene.render
    b_render.use_border = b_render.use_crop_to_border = True
    b_render.border_min_x, b_render.border_max_x = 0.25, 0.7
    b_render.border_min_y, b_render.border_max_y = 0.1, 0.8
    np.testing.assert_array_equal(render(tmp_path / "region.exr"), whole[10:44, 16:44])


def test_pixels_are_read_only_when_they_change() -> None:
    b_image = new_image(smooth_sky())
    b_mapping = add_environment(b_image)
    before = environment()
    b_mapping.inputs["Rotation"].default_value = (0.0, 0.0, 1.0)
    turned = environment()
    assert turned.image is before.image and turned != before
    set_light(b_image, smooth_sky(2.0))
    assert environment().image is before.image  # nobody said that anything changed
    world.images.look_again()
    changed = environment()
    assert changed.image is not before.image
    assert changed.image.pixels.max() < 0.5 * before.image.pixels.max()
    world.images.look_again()
    assert environment() == changed
    b_image.colorspace_settings.name = "Non-Color"
    assert environment().image is not changed.image


def test_a_file_that_was_saved_again_is_read_again(tmp_path: Path) -> None:
    path = tmp_path / "sky.exr"
    save_exr(path, smooth_sky())
    b_image = load_linear(path)
    add_environment(b_image)
    before = environment()
    world.images.look_again()
    assert environment() == before
    save_exr(path, smooth_sky(3.0))
    b_image.reload()
    world.images.look_again()
    assert environment().image.pixels.max() < 0.5 * before.image.pixels.max()


def test_packed_images_need_no_file(tmp_path: Path) -> None:
    save_exr(tmp_path / "sky.exr", smooth_sky())
    b_image = load_linear(tmp_path / "sky.exr")
    b_image.pack()
    (tmp_path / "sky.exr").unlink()
    add_environment(b_image)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "packed.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "packed.blend"))
    np.testing.assert_allclose(environment().image.pixels, smooth_sky(), rtol=1e-3)


def missing_image() -> Any:
    b_image = bpy.data.images.new("sky", 4, 4)
    b_image.source, b_image.filepath = "FILE", "//nowhere.exr"
    return b_image


def test_a_missing_image_is_named_and_the_color_is_shown(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    use_stipple()
    add_camera()
    add_capture(random_cloud(5))
    add_environment(missing_image(), 0.5)
    rendered = render(tmp_path / "frame.exr")
    np.testing.assert_allclose(rendered[0, 0], (0.1, 0.2, 0.3, 1.0), atol=1e-5)
    printed = capfd.readouterr()
    assert "World: the image sky is missing or cannot be read" in printed.out + printed.err
    assert "nowhere.exr" in printed.out + printed.err


def test_what_is_not_shown_is_said() -> None:
    b_mapping = add_environment(new_image(smooth_sky()))
    b_tree = b_mapping.id_data
    b_texture = next(b_node for b_node in b_tree.nodes if b_node.type == "TEX_ENVIRONMENT")
    b_background = next(b_node for b_node in b_tree.nodes if b_node.type == "BACKGROUND")

    def notice() -> str:
        return background_of(bpy.context.scene)[1]

    b_texture.projection = "MIRROR_BALL"
    assert "set the Environment Texture's projection to Equirectangular" in notice()
    b_texture.projection = "EQUIRECTANGULAR"
    b_texture.image.source = "SEQUENCE"
    assert "choose a single image" in notice()
    b_texture.image = None
    assert "has no image" in notice()
    b_mix = b_tree.nodes.new("ShaderNodeGamma")
    b_tree.links.new(b_mix.outputs[0], b_background.inputs["Color"])
    assert "the node 'Gamma' is not evaluated" in notice()
    assert isinstance(background_of(bpy.context.scene)[0], tuple)


def test_broken_pixels_are_mended() -> None:
    light = smooth_sky().astype(np.float32)
    light[3, 4] = np.inf
    light[5, 6] = np.nan
    add_environment(new_image(light))
    pixels = environment().image.pixels
    assert pixels[3, 4, 0] == 65504 and pixels[5, 6, 0] == 0


def test_the_scene_keeps_its_environment_from_frame_to_frame() -> None:
    add_capture(random_cloud())
    add_environment(new_image(smooth_sky()))
    cache = CloudCache()
    first, second = (scene_from_depsgraph(bpy.context.evaluated_depsgraph_get(), cache)[0] for _ in range(2))
    assert isinstance(first.background, Environment) and first.background == second.background
    residency.free()
    assert not world.images._known


def test_a_rotation_can_be_animated() -> None:
    b_mapping = add_environment(new_image(smooth_sky()))
    for frame, turn in ((1, 0.0), (11, 1.0)):
        b_mapping.inputs["Rotation"].default_value[2] = turn
        b_mapping.inputs["Rotation"].keyframe_insert("default_value", frame=frame)
    seen = []
    for frame in (1, 11):
        bpy.context.scene.frame_set(frame)
        seen.append(scene_from_depsgraph(bpy.context.evaluated_depsgraph_get(), CloudCache())[0].background)
    assert seen[0] == replace(seen[1], environment_from_world=seen[0].environment_from_world) != seen[1]
    np.testing.assert_allclose(seen[1].environment_from_world[0][:2], (np.cos(1), -np.sin(1)), atol=1e-6)


def test_film_transparent_keeps_it_out(tmp_path: Path) -> None:
    use_stipple().render.film_transparent = True
    add_camera()
    add_environment(new_image(smooth_sky()))
    assert (render(tmp_path / "frame.exr") == 0).all()


def test_the_picture_is_the_engines_light(tmp_path: Path) -> None:
    """Rec.709 light goes through the film and comes out of Blender's file."""
    use_stipple()
    add_camera()
    add_environment(new_image(np.broadcast_to((0.2, 3.0, 900.0), (4, 8, 3))))
    rendered = render(tmp_path / "frame.exr")
    encoded = np.array([[0.2, 3.0, 900.0, 1.0]]) ** (1 / 2.4) * 1.055 - 0.055
    encoded[:, 3] = 1
    np.testing.assert_allclose(rendered[5, 5], scene_linear_from_display(encoded)[0], rtol=1e-5)
