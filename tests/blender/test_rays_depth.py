# SPDX-License-Identifier: GPL-3.0-or-later
"""The Depth pass of *rays* beside another engine's: a mesh and a capture that cross, composited by depth."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest
from mathutils import Matrix

from stipple.addon.graphics import has_graphics
from tests import walls

from .captures import add_camera, add_capture, render_channel, use_stipple

pytestmark = [pytest.mark.blender, pytest.mark.skipif(not has_graphics(), reason="no EGL here")]

WORLD_FROM_CAMERA = Matrix(((1, 0, 0, 0), (0, 0, 1, 0), (0, -1, 0, 0), (0, 0, 0, 1)))  # y down, z forward to Blender's


def crossing_scene(order: str) -> tuple[Any, Any, Any]:
    """The scene, a capture of the one wall and a mesh of the other."""
    b_scene = use_stipple(walls.WIDTH, walls.HEIGHT, "RAYS")
    b_scene.stipple.ray_order, b_scene.stipple.samples = order, 64
    b_camera = add_camera((0.0, 0.0, 0.0))
    b_camera.data.lens = b_camera.data.sensor_width * walls.FOCAL_PX / walls.WIDTH
    b_capture = add_capture(walls.wall(1, (0.0, 1.0, 0.0)))
    b_data = bpy.data.meshes.new("Wall")
    b_data.from_pydata(walls.corners(0).tolist(), [], [(0, 1, 2, 3)])
    b_mesh = bpy.data.objects.new("Wall", b_data)
    b_scene.collection.objects.link(b_mesh)
    for b_object in (b_capture, b_mesh):
        b_object.matrix_world = WORLD_FROM_CAMERA
    bpy.context.view_layer.use_pass_z = True
    return b_scene, b_capture, b_mesh


def depth_by_cycles(b_scene: Any, path: Path) -> np.ndarray:
    """Of what is not hidden, through the middle of each pixel."""
    b_scene.render.engine = "CYCLES"
    b_scene.cycles.samples, b_scene.cycles.use_denoising = 1, False
    b_scene.cycles.pixel_filter_type, b_scene.cycles.filter_width = "BOX", 0.01
    return render_channel(path, "ViewLayer.Depth.Z")


@pytest.mark.parametrize("order", ["SORTED", "STOCHASTIC"])
def test_a_mesh_and_a_capture_cut_each_other_where_they_cross(tmp_path: Path, order: str) -> None:
    b_scene, b_capture, _ = crossing_scene(order)
    capture = render_channel(tmp_path / "capture.exr", "ViewLayer.Depth.Z")
    b_capture.hide_render = True
    mesh = depth_by_cycles(b_scene, tmp_path / "mesh.exr")
    of_mesh, of_capture = walls.depths()
    np.testing.assert_allclose(mesh, of_mesh, rtol=1e-3)  # the two engines measure along the same axis
    # The pixel filter gives flat splats some thickness, which shows where a ray grazes them.
    np.testing.assert_allclose(capture, of_capture, rtol=3e-3)
    assert 0.2 < (mesh < capture).mean() < 0.8
    assert walls.misplaced(mesh < capture).max() < 0.5  # [px]
