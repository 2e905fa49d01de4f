# SPDX-License-Identifier: GPL-3.0-or-later
"""*rays* on Blender's gpu module: moderngl's picture, frame after frame, and machines without graphics."""

from __future__ import annotations

from pathlib import Path

import bpy
import numpy as np
import pytest

from stipple.addon.camera import camera_from_blender
from stipple.addon.graphics import has_graphics
from stipple.addon.render_engine import StippleRenderEngine
from stipple.addon.residency import CloudCache
from stipple.addon.sync import scene_from_depsgraph
from stipple.engine.colour import scene_linear_from_display
from stipple.engine.splats import ARRAY_NAMES

from .captures import add_camera, add_capture, random_cloud, render, use_stipple
from .fresh_process import fresh_python

pytestmark = [pytest.mark.blender, pytest.mark.skipif(not has_graphics(), reason="no EGL here")]


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
