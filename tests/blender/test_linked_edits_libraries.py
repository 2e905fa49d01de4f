# SPDX-License-Identifier: GPL-3.0-or-later
"""Edited linked captures in another .blend than the one that they were saved with: linked and appended."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest

from stipple.addon.capture_panel import edits_state_of
from stipple.addon.linked_edits import found_edits

from .captures import add_camera, random_cloud, render, use_stipple, write_ply
from .editing import activate, refused
from .linked import save
from .linked_editing import edited_scene, edits_files, load

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


@pytest.fixture
def library(b_object: Any, tmp_path: Path) -> Path:
    """A saved .blend with the edited capture, which is not open any more."""
    (tmp_path / "library").mkdir()
    save(tmp_path / "library" / "library.blend")
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    return tmp_path / "library" / "library.blend"


def append(library: Path) -> Any:
    """The object appended from the library, in a scene to be rendered."""
    bpy.ops.wm.append(directory=f"{library}/Object/", filename="garden")
    b_object = bpy.data.objects["garden"]
    activate(b_object)
    add_camera()
    use_stipple()
    return b_object


@pytest.mark.parametrize("saved", [False, True])
def test_an_appended_capture_takes_its_edits_along(library: Path, tmp_path: Path, saved: bool) -> None:
    (tmp_path / "shots").mkdir()
    if saved:
        save(tmp_path / "shots" / "library.blend")
        (tmp_path / "shots" / "library.garden.edits.npz").write_bytes(b"of another capture")
    b_object = append(library)
    token = b_object.data.stipple_capture.edits
    assert found_edits(b_object.data, "garden").edits.token == token
    assert edits_state_of(b_object.data) == ("Edited; saved with the .blend file", "INFO")
    before = render(tmp_path / "before.exr")
    assert bpy.ops.stipple.select_all(action="SELECT") == {"FINISHED"}
    save(tmp_path / "shots" / "shot.blend")
    (tmp_path / "library").rename(tmp_path / "away")
    b_object = load(tmp_path / "shots" / "shot.blend")
    assert np.array_equal(render(tmp_path / "after.exr"), before)
    assert edits_state_of(b_object.data) == ("Edits: shot.garden.edits.npz", "GREASEPENCIL")


def test_edits_that_an_appended_capture_cannot_find_are_named(library: Path, tmp_path: Path) -> None:
    edits = library.with_name("library.garden.edits.npz")
    edits.rename(tmp_path / "away.npz")
    save(tmp_path / "shot.blend")
    b_object = append(library)
    sentence = (
        f"garden: its edits are missing, there is no such file as {tmp_path / edits.name} or {edits}; put it back, or "
        "show the capture without them by Object Data properties > Linked Capture > Discard."
    )
    with refused(sentence):
        render(tmp_path / "now.exr")
    with refused(sentence):
        bpy.ops.stipple.select_all(action="SELECT")
    assert edits_state_of(b_object.data) == ("Edits: library.garden.edits.npz is missing", "ERROR")
    bpy.ops.stipple.discard_edits()
    assert render(tmp_path / "now.exr").any()
