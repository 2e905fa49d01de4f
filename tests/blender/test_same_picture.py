# SPDX-License-Identifier: GPL-3.0-or-later
"""F12 and `stipple render` make the same picture of a real capture from the same camera of the same file."""

from __future__ import annotations

from pathlib import Path

import bpy
import numpy as np
import pytest

from tests.blender.captures import pixels_of, render, use_stipple

pytestmark = [pytest.mark.blender, pytest.mark.real]
SIZE = (640, 480)


@pytest.mark.parametrize("name", ["koala", "rubber_toy_cloud"])
@pytest.mark.parametrize("transparent", [True, False])
@pytest.mark.parametrize("as_animation", [True, False])
def test_f12_equals_the_command_line(
    shared_data: Path, tmp_path: Path, name: str, transparent: bool, as_animation: bool
) -> None:
    cli = pytest.importorskip("stipple.engine.cli")
    pytest.importorskip("click")
    capture = shared_data / "real" / f"{name}.ply"
    cameras = shared_data / "real" / f"{name}_cameras.json"
    background = ["--background", "transparent" if transparent else "0,0,0"]
    arguments = ["render", str(capture), "--out", str(tmp_path / "cli.png"), "--camera", f"{cameras}:2"]
    assert cli.main([*arguments, "--method", "sorted", "--device", "cpu", *background]) == 0
    bpy.ops.import_scene.splats(filepath=str(capture))
    bpy.ops.import_scene.splat_cameras(filepath=str(cameras), as_animation=as_animation)
    b_scene = use_stipple(*SIZE)
    if as_animation:
        b_scene.frame_set(b_scene.frame_start + 2)
    else:
        b_scene.camera = bpy.data.collections[cameras.stem].objects["0002"]
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
