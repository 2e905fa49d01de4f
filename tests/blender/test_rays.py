# SPDX-License-Identifier: GPL-3.0-or-later
"""*rays* on Blender's gpu module: moderngl's picture, frame after frame, and machines without graphics."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import bpy
import numpy as np
import pytest

from stipple.addon import sync
from stipple.addon.camera import camera_from_blender
from stipple.addon.graphics import has_graphics
from stipple.addon.render_engine import StippleRenderEngine
from stipple.addon.residency import CloudCache
from stipple.addon.sync import scene_from_depsgraph
from stipple.engine.colour import display_from_scene_linear, scene_linear_from_display
from stipple.engine.formats import read_splats
from stipple.engine.formats.cameras_file import read_cameras
from stipple.engine.scene import Scene
from stipple.engine.splats import ARRAY_NAMES
from tests.oracle.rays import render as oracle
from tests.scenes import absurd_cloud, scene_of
from tests.stats.image_metrics import psnr

from .captures import add_camera, add_capture, random_cloud, render, use_stipple
from .fresh_process import fresh_python

pytestmark = [pytest.mark.blender, pytest.mark.skipif(not has_graphics(), reason="no EGL here")]

WORLD_FROM_FRONT = np.array([[1.0, 0, 0, 0], [0, 0, 1, -4], [0, -1, 0, 0]])  # what tests.scenes puts before its camera


def rays_scene(order: str = "SORTED"):  # type: ignore[no-untyped-def]
    b_scene = use_stipple(160, 120, "RAYS")
    b_scene.stipple.ray_order = order
    b_scene.render.film_transparent = True
    add_camera()
    add_capture(random_cloud(300, degree=3))
    return b_scene


# moderngl draws in a process of its own: bpy may abort at exit where both have a graphics context.
MODERNGL = """
import sys, numpy as np
from stipple.engine.camera import Camera
from stipple.engine.renderer import Renderer
from stipple.engine.scene import Instance, Scene
from stipple.engine.settings import Settings
from stipple.engine.splats import ARRAY_NAMES, SplatCloud
data = np.load(sys.argv[1])
cloud = SplatCloud(**{name: data[name] for name in ARRAY_NAMES})
intrinsics = {name: float(data[name]) for name in ("fx", "fy", "cx", "cy", "near", "far")}
camera = Camera(data["camera_from_world"], 160, 120, **intrinsics)
scene = Scene((Instance(cloud, data["world_from_object"]),))
settings = Settings(method="rays", samples=4, ray_order=str(data["order"]))
np.save(sys.argv[2], Renderer("cpu").render(scene, camera, settings).rgba)
"""


@pytest.mark.parametrize("order", ["SORTED", "STOCHASTIC"])
def test_both_hosts_draw_the_same_picture(tmp_path: Path, root: Path, order: str) -> None:
    pytest.importorskip("moderngl")
    b_scene = rays_scene(order)
    blender = render(tmp_path / "blender.exr")
    depsgraph = bpy.context.evaluated_depsgraph_get()
    scene, _ = scene_from_depsgraph(depsgraph, CloudCache())
    camera = camera_from_blender(b_scene.camera.evaluated_get(depsgraph), b_scene.render)
    (instance,) = scene.instances
    values = {name: getattr(instance.cloud, name) for name in ARRAY_NAMES}
    values |= {name: getattr(camera, name) for name in ("camera_from_world", "fx", "fy", "cx", "cy", "near", "far")}
    values |= {"world_from_object": instance.world_from_object, "order": order.lower()}
    np.savez(tmp_path / "scene.npz", **values)
    fresh_python(root, MODERNGL, tmp_path / "scene.npz", tmp_path / "wanted.npy")
    wanted = scene_linear_from_display(np.load(tmp_path / "wanted.npy"))
    assert wanted[..., 3].mean() > 0.1
    assert np.abs(blender - wanted).max() <= 1 / 255  # bit-identical on llvmpipe


def test_three_frames_and_back_to_another_method(tmp_path: Path) -> None:
    """A frame's textures and framebuffers end with its graphics context; the next makes its own."""
    b_scene = rays_scene()
    pictures = [render(tmp_path / f"{index}.exr") for index in range(3)]
    assert StippleRenderEngine.bl_use_gpu_context
    assert all(np.array_equal(pictures[0], picture) for picture in pictures)
    b_scene.stipple.method = "SORTED"
    assert not StippleRenderEngine.bl_use_gpu_context
    assert np.abs(render(tmp_path / "sorted.exr") - pictures[0]).mean() < 0.05


def test_a_loaded_file_brings_the_graphics_context(tmp_path: Path) -> None:
    rays_scene()
    before = render(tmp_path / "before.exr")
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "rays.blend"))
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    assert not StippleRenderEngine.bl_use_gpu_context
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "rays.blend"))
    assert StippleRenderEngine.bl_use_gpu_context
    assert np.array_equal(render(tmp_path / "after.exr"), before)


@pytest.mark.real
@pytest.mark.parametrize(("view", "forward"), [(0, 0.0), (5, 0.0), (2, 0.9)])
def test_blenders_pictures_are_the_oracles(tmp_path: Path, shared_data: Path, view: int, forward: float) -> None:
    """The koala at 640 × 480, a part of 64 × 48; the last view is 0.9 of the way into its middle."""
    camera = read_cameras(shared_data / "real" / "koala_cameras.json")[view]
    cloud = read_splats(shared_data / "real" / "koala.ply").cloud
    b_scene = use_stipple(camera.width, camera.height, "RAYS")
    b_scene.render.film_transparent = b_scene.render.use_border = True
    b_scene.render.border_min_x, b_scene.render.border_max_x = 288 / 640, 352 / 640
    b_scene.render.border_min_y, b_scene.render.border_max_y = 216 / 480, 264 / 480
    b_camera, eye = add_camera(), camera.position
    pose = np.eye(4)
    pose[:3, :3] = camera.camera_from_world[:, :3].T * [1, -1, -1]
    pose[:3, 3] = eye + forward * (np.median(cloud.position, axis=0) - eye)
    b_camera.matrix_world = pose.T.tolist()
    b_camera.data.lens = b_camera.data.sensor_width * camera.fx / camera.width
    b_camera.data.clip_start = 0.01
    add_capture(cloud)
    bpy.context.view_layer.update()
    depsgraph = bpy.context.evaluated_depsgraph_get()
    scene, _ = scene_from_depsgraph(depsgraph, CloudCache())
    wanted = oracle(scene, camera_from_blender(b_camera.evaluated_get(depsgraph), b_scene.render), dilation_px2=0.3)
    picture = render(tmp_path / "koala.exr")[216:264, 288:352]
    assert wanted.rgba.shape == picture.shape and wanted.rgba[..., 3].mean() > 0.5
    assert psnr(display_from_scene_linear(picture), wanted.rgba) > 60  # 45 is promised


@pytest.mark.parametrize("order", ["SORTED", "STOCHASTIC"])
def test_absurd_input_makes_no_nan_in_blender(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, order: str) -> None:
    """Handed to the graphics module as it is, as no datablock would be: nonsense in every field, all of it at once."""
    rays_scene(order)
    scenes = [scene_of(absurd_cloud())]
    honest = absurd_cloud()
    for name, value in (("scale", 0.0), ("scale", 1e30), ("scale", np.nan), ("opacity", np.nan), ("position", np.nan)):
        scenes.append(scene_of(replace(honest, **{name: np.full_like(getattr(honest, name), value)})))
    for index, scene in enumerate(scenes):
        turned = replace(scene.instances[0], world_from_object=WORLD_FROM_FRONT)
        monkeypatch.setattr(sync, "scene_from_depsgraph", lambda *_, turned=turned: (Scene((turned,)), ()))
        picture = render(tmp_path / f"{index}.exr")
        assert np.isfinite(picture).all()
        assert (picture[..., 3].mean() > 0.1) == (index == 0)


def test_absurd_attributes_and_a_million_splats_behind_the_camera(tmp_path: Path) -> None:
    """Through a datablock, which drops what has no number: what is left is drawn as if the rest had not been there."""
    b_scene = use_stipple(160, 120, "RAYS")
    b_scene.render.film_transparent = True
    add_camera()
    cloud = random_cloud(1_000_000, degree=0, size=0.01)
    cloud.position[:, 1] -= 10.0  # the camera is at y = -4 and looks along +y
    cloud.scale[:10], cloud.opacity[10:20], cloud.scale[20:30] = 1e30, np.nan, 0.0
    b_million = add_capture(cloud)
    assert (render(tmp_path / "behind.exr") == 0).all()
    add_capture(random_cloud(300, degree=3))
    both = render(tmp_path / "both.exr")
    b_million.hide_render = True
    assert both[..., 3].mean() > 0.1
    assert (render(tmp_path / "alone.exr") == both).all()


WITHOUT_GRAPHICS = """
import sys, bpy, stipple
stipple.register()
from tests.blender.captures import add_camera, add_capture, random_cloud, use_stipple
b_scene = use_stipple(32, 24, "RAYS")
add_camera(); add_capture(random_cloud())
b_scene.render.filepath = sys.argv[1]
try:
    bpy.ops.render.render(write_still=True)
except RuntimeError as error:
    print("REFUSED", error)
b_scene.stipple.method = "SORTED"
bpy.ops.render.render(write_still=True)
print("SURVIVED")
"""


def test_without_graphics_rays_is_refused_with_a_sentence_and_sorted_works(tmp_path: Path, root: Path) -> None:
    hidden = {"__EGL_VENDOR_LIBRARY_FILENAMES": "/nonexistent.json", "DISPLAY": ""}
    printed = fresh_python(root, WITHOUT_GRAPHICS, tmp_path / "picture.png", **hidden)
    assert "REFUSED" in printed and "choose the method Sorted instead" in printed
    assert "SURVIVED" in printed and (tmp_path / "picture.png").exists()


VIEWPORT_WITHOUT_GRAPHICS = """
from stipple.addon import residency
from stipple.addon.viewport_rays import RaysViewportSession
from stipple.engine.renderer import Renderer
from tests.blender.test_viewport import aim, never, random_cloud
session = RaysViewportSession(lambda: None)
session.aim_at(aim(random_cloud(), 0.0, "rays"))
session.step(Renderer("cpu"), never)
session.render(residency.raster_renderer("cpu"))
print(session.status())
print("RESTS" if session.due() is None else "GOES ON")
"""


def test_without_graphics_the_viewport_says_so_and_rests(root: Path) -> None:
    hidden = {"__EGL_VENDOR_LIBRARY_FILENAMES": "/nonexistent.json", "DISPLAY": ""}
    printed = fresh_python(root, VIEWPORT_WITHOUT_GRAPHICS, **hidden)
    assert "choose the method Sorted instead" in printed and "RESTS" in printed
