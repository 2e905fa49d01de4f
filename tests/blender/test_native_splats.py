# SPDX-License-Identifier: GPL-3.0-or-later
"""Blender 5.3's own Gaussian splats: its importer's objects in Stipple, and Stipple's objects in its engines."""

from __future__ import annotations

from pathlib import Path

import bpy
import mathutils
import numpy as np
import pytest

from stipple.addon.splat_data import cloud_from_datablock, is_capture
from stipple.engine.formats import read_splats

from .captures import ARRAYS, add_camera, add_capture, random_cloud, render, use_stipple, write_ply

HAS_NATIVE = "type" in bpy.types.PointCloud.bl_rna.properties
pytestmark = [
    pytest.mark.blender,
    pytest.mark.skipif(not HAS_NATIVE, reason="Blender before 5.3 has no splats of its own"),
]


@pytest.mark.parametrize("degree", [0, 1, 2, 3])
def test_blenders_importer_makes_captures(tmp_path: Path, degree: int) -> None:
    path = write_ply(tmp_path / "statue.ply", random_cloud(degree=degree))
    assert bpy.ops.wm.ply_import(filepath=str(path)) == {"FINISHED"}
    b_data = bpy.context.view_layer.objects.active.data
    assert is_capture(b_data)
    cloud, dropped = cloud_from_datablock(b_data, "statue")
    assert cloud is not None and dropped == 0
    ours = read_splats(path).cloud
    for name in ARRAYS:  # its exponential and ours differ in the last bit
        np.testing.assert_allclose(getattr(cloud, name), getattr(ours, name), rtol=1e-6, err_msg=name)


def test_both_importers_give_the_same_picture(tmp_path: Path) -> None:
    path = write_ply(tmp_path / "statue.ply", random_cloud(degree=3))
    use_stipple(method="SORTED")
    add_camera()
    pictures = []
    for load in (
        lambda: bpy.ops.import_scene.splats(filepath=str(path)),
        lambda: bpy.ops.wm.ply_import(filepath=str(path)),
    ):
        assert load() == {"FINISHED"}
        b_object = bpy.context.view_layer.objects.active
        b_object.matrix_world = mathutils.Matrix()
        pictures.append(render(tmp_path / "picture.exr"))
        bpy.data.objects.remove(b_object)
    assert pictures[0][..., :3].max() > 0.1
    assert np.abs(pictures[0] - pictures[1]).max() < 1e-4


def test_a_capture_is_of_the_type_that_blenders_engines_draw(tmp_path: Path) -> None:
    b_object = add_capture(random_cloud(degree=3))
    assert b_object.data.type == "GAUSSIAN_SPLAT"
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "a.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "a.blend"))
    assert bpy.data.pointclouds[0].type == "GAUSSIAN_SPLAT"


def test_cycles_draws_a_capture_as_stipple_does(tmp_path: Path) -> None:
    """Not to the last bit: Cycles meets each splat where a ray is closest to it, and knows no filter of 0.3 px²."""
    b_scene = use_stipple(method="SORTED")
    b_scene.stipple.dilation_px2 = 0.0
    add_camera()
    add_capture(random_cloud(degree=1))
    ours = render(tmp_path / "ours.exr")
    b_scene.render.engine = "CYCLES"
    b_scene.cycles.samples, b_scene.cycles.use_denoising = 64, False
    theirs = render(tmp_path / "theirs.exr")
    seen = ours[..., 3] > 0.2
    assert seen.mean() > 0.01
    correlation = np.corrcoef(ours[seen][:, :3].ravel(), theirs[seen][:, :3].ravel())[0, 1]
    mirrored = np.corrcoef(ours[seen][:, :3].ravel(), theirs[:, ::-1][seen][:, :3].ravel())[0, 1]
    assert correlation > 0.9 > mirrored
