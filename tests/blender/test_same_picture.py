# SPDX-License-Identifier: GPL-3.0-or-later
"""F12 and `stipple render` make the same picture of a real capture from the same camera."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest
from mathutils import Matrix

from stipple.engine.formats.cameras_file import read_cameras
from tests.blender.captures import pixels_of, render, use_stipple

pytestmark = [pytest.mark.blender, pytest.mark.real]
SIZE = (640, 480)


def place_camera(world_from_capture: Any, camera: Any) -> None:
    """Blender's camera where an engine camera stands that sees the capture in its own axes."""
    b_data = bpy.data.cameras.new("Camera")
    b_data.sensor_fit = "HORIZONTAL"
    b_data.lens = camera.fx / camera.width * b_data.sensor_width
    b_data.clip_start, b_data.clip_end = camera.near, 1000.0
    b_camera = bpy.data.objects.new("Camera", b_data)
    camera_from_capture = Matrix([*camera.camera_from_world.tolist(), [0, 0, 0, 1]])
    # Blender's camera looks along -z with y up, the engine's along z with y down.
    b_camera.matrix_world = world_from_capture @ camera_from_capture.inverted() @ Matrix.Diagonal((1, -1, -1, 1))
    bpy.context.scene.collection.objects.link(b_camera)
    bpy.context.scene.camera = b_camera


@pytest.mark.parametrize("name", ["koala", "rubber_toy_cloud"])
@pytest.mark.parametrize("transparent", [True, False])
def test_f12_equals_the_command_line(shared_data: Path, tmp_path: Path, name: str, transparent: bool) -> None:
    cli = pytest.importorskip("stipple.engine.cli")
    pytest.importorskip("click")
    capture = shared_data / "real" / f"{name}.ply"
    cameras = shared_data / "real" / f"{name}_cameras.json"
    background = ["--background", "transparent" if transparent else "0,0,0"]
    arguments = ["render", str(capture), "--out", str(tmp_path / "cli.png"), "--camera", f"{cameras}:2"]
    assert cli.main([*arguments, "--method", "sorted", "--device", "cpu", *background]) == 0
    bpy.ops.import_scene.splats(filepath=str(capture))
    place_camera(bpy.context.object.matrix_world, read_cameras(cameras)[2])
    b_scene = use_stipple(*SIZE)
    b_scene.render.film_transparent = transparent
    blender = render(tmp_path / "blender.png")
    difference = np.abs(np.rint(255 * blender) - np.rint(255 * pixels_of(tmp_path / "cli.png")))
    assert difference[..., 3].max() <= 1
    # Where alpha is a few levels of 255, straight colour is a ratio of roundings (one pixel of koala's differs by 3);
    # what it puts over any background is compared there.
    alpha = blender[..., 3]
    assert difference[alpha > 0.05].max() <= 1
    assert (difference[..., :3] * alpha[..., None]).max() <= 1
    assert alpha.mean() > 0.1
