# SPDX-License-Identifier: GPL-3.0-or-later
"""The coloured points of Solid shading: which, how large, and where they come to lie on the screen."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest

from stipple.addon import overlay
from stipple.addon.graphics import has_graphics
from stipple.addon.overlay_points import OVERLAY_GAMMA, overlay_points
from stipple.addon.splat_data import write_attribute, write_cloud
from stipple.engine.errors import StippleError
from stipple.engine.splats import SH_C0

from .captures import add_capture, random_cloud
from .fresh_process import fresh_python

pytestmark = pytest.mark.blender


def as_mesh(cloud: Any) -> Any:
    b_mesh = bpy.data.meshes.new("Mesh")
    b_mesh.vertices.add(cloud.splat_count)
    write_cloud(b_mesh, cloud)
    return b_mesh


@pytest.mark.parametrize("kind", ["own", "mesh"])
def test_all_points_of_a_small_capture_have_their_place_and_colour(kind: str) -> None:
    cloud = random_cloud(500)
    b_data = add_capture(cloud).data if kind == "own" else as_mesh(cloud)
    points = overlay_points(b_data, "it")
    order = np.lexsort(points.place[:, :3].T)
    expected = np.lexsort(cloud.position.T)
    np.testing.assert_array_equal(points.place[order, :3], cloud.position[expected])
    encoded = np.clip(0.5 + SH_C0 * cloud.sh_dc[expected], 0, 1)
    np.testing.assert_allclose(points.colour[order, :3] ** (1 / OVERLAY_GAMMA), encoded, atol=1e-5)
    assert (points.colour[:, 3] == 1).all()


def test_mesh_and_point_cloud_get_the_same_radii() -> None:
    cloud = random_cloud(500)
    own, mesh = overlay_points(add_capture(cloud).data, "own"), overlay_points(as_mesh(cloud), "mesh")
    np.testing.assert_allclose(own.place, mesh.place, rtol=1e-6)


def test_faint_splats_are_small_and_invisible_ones_left_out() -> None:
    cloud = random_cloud(3)
    scale = np.full((3, 3), 0.1, np.float32)
    cloud = replace(cloud, scale=scale, opacity=np.array([1.0, 0.25, 0.001], np.float32))
    radius = np.sort(overlay_points(as_mesh(cloud), "it").place[:, 3])
    np.testing.assert_allclose(radius, [0.125, 0.25], rtol=1e-5)


def test_fewer_points_are_spread_evenly_and_cover_as_much() -> None:
    cloud = random_cloud(10_000)
    position = np.stack([np.arange(10_000), np.zeros(10_000), np.zeros(10_000)], axis=1).astype(np.float32)
    scale = np.full((10_000, 3), 0.1, np.float32)
    b_data = as_mesh(replace(cloud, position=position, scale=scale, opacity=np.ones(10_000, np.float32)))
    points = overlay_points(b_data, "it", most=100)
    np.testing.assert_array_equal(np.sort(points.place[:, 0]), np.arange(100) * 100)
    np.testing.assert_allclose(points.place[:, 3], 0.25 * 10, rtol=1e-5)  # 100 times fewer: 10 times as wide
    few = np.sort(points.place[:20, 0])
    assert few[0] < 2500 and few[-1] > 7500 and np.diff(few).max() < 4000


def test_what_cannot_be_drawn_is_left_out_or_said() -> None:
    cloud = random_cloud(10)
    b_data = as_mesh(cloud)
    position = cloud.position.copy()
    position[3] = np.nan
    write_attribute(b_data, "position", "FLOAT_VECTOR", position)
    assert len(overlay_points(b_data, "it").place) == 9
    b_data.attributes.remove(b_data.attributes["scale"])
    with pytest.raises(StippleError, match="it: the point attribute 'scale' is missing"):
        overlay_points(b_data, "it")


def test_files_without_captures_are_looked_through_once(monkeypatch: pytest.MonkeyPatch) -> None:
    looked = []
    monkeypatch.setattr(overlay, "is_capture", lambda b_data: looked.append(b_data.name) or False)
    for index in range(3):
        bpy.data.meshes.new(f"Mesh {index}")
    drawn = overlay.CaptureOverlay()
    assert not drawn._has_captures() and not drawn._has_captures()
    assert len(looked) == 3
    monkeypatch.undo()
    add_capture(random_cloud(5))
    assert drawn._has_captures()


def test_geometry_that_becomes_a_capture_is_noticed() -> None:
    b_mesh = bpy.data.meshes.new("Mesh")
    b_mesh.vertices.add(5)
    b_object = bpy.data.objects.new("Object", b_mesh)
    bpy.context.scene.collection.objects.link(b_object)
    bpy.context.view_layer.update()
    drawn = overlay.CaptureOverlay()
    assert not drawn._has_captures()

    def update(*_: Any) -> None:
        drawn.scene_changed(bpy.context.evaluated_depsgraph_get())

    bpy.app.handlers.depsgraph_update_post.append(update)
    try:
        write_cloud(b_mesh, random_cloud(5))
        bpy.context.view_layer.update()
    finally:
        bpy.app.handlers.depsgraph_update_post.remove(update)
    assert drawn._has_captures() and drawn._stale


# In a render, where every Blender has a graphics context, and in a process of its own, at whose end bpy 4.5 hangs.
PROGRAM = """
import json, os, sys
import numpy as np
import bpy, gpu
from mathutils import Matrix
from stipple.addon.overlay_draw import OverlayPainter, points_batch
from stipple.addon.overlay_points import OverlayPoints

SIZE = 200
place = np.array([[0, 0, 0, 0.5], [0, 0, -1, 0.9], [1.2, 0, 0, 0.1]], np.float32)  # near, far behind it, beside
colour = np.array([[1, 0, 0, 1], [0, 1, 0, 1], [0, 0, 1, 1]], np.float32)

def draw(batch, projection, in_front=False, wall=1.0, count=3, scale=1.0):
    target = gpu.types.GPUOffScreen(SIZE, SIZE, format="RGBA32F")
    with target.bind():
        framebuffer = gpu.state.active_framebuffer_get()
        framebuffer.clear(color=(0, 0, 0, 0), depth=wall)
        gpu.matrix.load_matrix(Matrix.Translation((0, 0, -4)))
        gpu.matrix.load_projection_matrix(projection)
        with OverlayPainter() as painter:
            painter.points(batch, count, Matrix.Scale(scale, 4), in_front)
        buffer = framebuffer.read_color(0, 0, SIZE, SIZE, 4, 0, "FLOAT")
        buffer.dimensions = SIZE * SIZE * 4
        pixels = np.array(buffer, np.float32).reshape(SIZE, SIZE, 4)
    target.free()
    return pixels

near, far = 0.1, 100.0
a, b = -(far + near) / (far - near), -2 * far * near / (far - near)
perspective = Matrix(((2, 0, 0, 0), (0, 2, 0, 0), (0, 0, a, b), (0, 0, -1, 0)))
orthographic = Matrix(((0.5, 0, 0, 0), (0, 0.5, 0, 0), (0, 0, -2 / (far - near), -(far + near) / (far - near)),
                       (0, 0, 0, 1)))

def draw_all():
    batch = points_batch(OverlayPoints(place, colour))
    yield "perspective", draw(batch, perspective)
    yield "orthographic", draw(batch, orthographic)
    yield "large", draw(batch, orthographic, scale=2.0)
    yield "two", draw(batch, orthographic, count=2)
    yield "behind a wall", draw(batch, perspective, wall=0.0)
    yield "in front of a wall", draw(batch, perspective, True, 0.0)

class Engine(bpy.types.RenderEngine):
    bl_idname, bl_label, bl_use_gpu_context = "POINTS_TEST", "Points Test", True
    def render(self, depsgraph):
        counts = {name: [int((pixels[..., c] > 0.5).sum()) for c in range(3)] for name, pixels in draw_all()}
        json.dump(counts, open(sys.argv[1], "w"))

bpy.utils.register_class(Engine)
bpy.context.scene.render.engine = "POINTS_TEST"
bpy.ops.render.render()
sys.stdout.flush()
os._exit(0)
"""


@pytest.mark.skipif(not has_graphics(), reason="no EGL here")
def test_points_hide_each_other_and_have_their_size_in_every_projection(root: Path, tmp_path: Path) -> None:
    told = tmp_path / "told.json"
    fresh_python(root, PROGRAM, told)
    counts = json.loads(told.read_text())

    def rhombus(radius_px: float) -> float:
        return 2 * (1.05 * radius_px) ** 2  # a little larger than Blender's own, so that no gray is left

    # At distance 4 a unit is 50 px in perspective, and 50 px everywhere in the orthographic view.
    red, green, blue = counts["orthographic"]
    assert red == pytest.approx(rhombus(25), rel=0.05) and blue == pytest.approx(rhombus(5), rel=0.2)
    assert green == pytest.approx(rhombus(45) - rhombus(25), rel=0.05)
    assert counts["perspective"][0] == pytest.approx(rhombus(25), rel=0.05)
    assert counts["perspective"][1] == pytest.approx(rhombus(36) - rhombus(25), rel=0.05)  # a unit further away
    assert counts["large"][0] == pytest.approx(4 * red, rel=0.1)
    assert counts["two"] == [red, green, 0]
    assert counts["behind a wall"] == [0, 0, 0] and counts["in front of a wall"] == counts["perspective"]
