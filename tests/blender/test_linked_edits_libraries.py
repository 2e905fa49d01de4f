# SPDX-License-Identifier: GPL-3.0-or-later
"""Edited linked captures in another .blend than the one that they were saved with: linked and appended."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest

from .captures import add_camera, random_cloud, render, use_stipple, write_ply
from .linked import save
from .linked_editing import edited_scene, edits_files

pytestmark = pytest.mark.blender

COUNT = 2_000


@pytest.fixture
def b_object(tmp_path: Path) -> Any:
    """A linked capture with edits, in a scene to be rendered."""
    return edited_scene(write_ply(tmp_path / "garden.ply", random_cloud(COUNT, degree=1)))


def test_data_linked_from_another_blend_shows_its_edits(b_object: Any, tmp_path: Path) -> None:
    before = render(tmp_path / "before.exr")
    (tmp_path / "library").mkdir()
    save(tmp_path / "library" / "library.blend")
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    with bpy.data.libraries.load(str(tmp_path / "library" / "library.blend"), link=True) as (_, wanted):
        wanted.objects = ["garden"]
    b_object = wanted.objects[0]
    bpy.context.scene.collection.objects.link(b_object)
    add_camera()
    use_stipple()
    assert np.array_equal(render(tmp_path / "after.exr"), before)
    save(tmp_path / "shot.blend")
    assert edits_files(tmp_path) == []
