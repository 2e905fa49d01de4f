# SPDX-License-Identifier: GPL-3.0-or-later
"""Edits of a linked capture applied to a copy of its file, and what cannot be kept as an edit."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest

from stipple.addon.edit.operator import session_in
from stipple.addon.edit.ui import counts
from stipple.addon.linked_capture import is_linked, path_of
from stipple.addon.splat_data import splat_count_of
from stipple.engine.formats import read_splats

from .captures import add_camera, random_cloud, render, use_stipple, write_ply
from .editing import refused
from .linked_editing import COUNT, LEFT, edit_everything, edited_link, left_of

pytestmark = pytest.mark.blender


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return write_ply(tmp_path / "garden.ply", random_cloud(COUNT, degree=2))


@pytest.fixture
def b_object(path: Path) -> Any:
    return edited_link(path)


def test_what_adds_splats_is_refused_and_changes_nothing(b_object: Any) -> None:
    bpy.ops.stipple.select_sphere(**LEFT)
    token = b_object.data.stipple_capture.edits
    dab = {"name": "", "location": (0, 0, 0), "radius": 0.5}
    for call, name in (
        (bpy.ops.stipple.duplicate, "Duplicate Splats"),
        (lambda: bpy.ops.stipple.clone(stroke=[dab], source=(1, 0, 0)), "Clone Splats"),
    ):
        with refused(f"garden: {name} adds splats", "apply the edits to a copy and import that"):
            call()
    with refused("garden: invalid splats of a linked capture are never shown"):
        bpy.ops.stipple.delete_invalid()
    assert b_object.data.stipple_capture.edits == token and len(bpy.data.objects) == 1
    assert session_in(bpy.context).cloud.splat_count == COUNT


def test_the_selection_becomes_an_object_of_its_own(b_object: Any, path: Path, tmp_path: Path) -> None:
    """In full precision, with the edits, and the picture stays what it was."""
    add_camera()
    use_stipple()
    bpy.ops.stipple.select_sphere(**LEFT)
    bpy.ops.stipple.rotate(value=0.6, axis=(0, 1, 0.3))
    whole = render(tmp_path / "whole.exr")
    assert bpy.ops.stipple.separate() == {"FINISHED"}
    b_new = next(b_other for b_other in bpy.data.objects if b_other.name == "garden.001")
    assert not is_linked(b_new.data) and not b_new.stipple_editing and splat_count_of(b_new.data) == left_of(path).sum()
    assert counts(b_object.data)["Splats"] == COUNT - left_of(path).sum() and "Deleted" not in counts(b_object.data)
    assert np.sqrt(np.mean(np.square(render(tmp_path / "parts.exr") - whole))) < 0.004
    with refused("nothing is selected to separate"):
        bpy.ops.stipple.separate()
    with refused("no splats are deleted"):
        bpy.ops.stipple.restore()


def test_joining_and_exporting_the_proxy_by_mistake_is_refused(b_object: Any, path: Path, tmp_path: Path) -> None:
    bpy.ops.stipple.edit_mode_toggle()
    bpy.ops.import_scene.splats(filepath=str(path), up_axis="Z")
    for b_other in bpy.context.view_layer.objects:
        b_other.select_set(True)
    with refused("its splats stay in their file; import the file to join it"):
        bpy.ops.stipple.join()
    with refused("its splats stay in their file; use Linked Capture > Apply to Copy"):
        bpy.ops.export_scene.splats(filepath=str(tmp_path / "out.ply"))
    assert not (tmp_path / "out.ply").exists() and len(bpy.data.objects) == 2


def test_edits_applied_to_a_copy(b_object: Any, path: Path, tmp_path: Path) -> None:
    add_camera()
    use_stipple()
    edit_everything()
    edited = render(tmp_path / "edited.exr")
    source, count = path.read_bytes(), counts(b_object.data)["Splats"]
    b_second = b_object.copy()
    b_second.data = b_object.data.copy()
    assert bpy.ops.stipple.apply_edits(filepath=str(tmp_path / "copy.ply")) == {"FINISHED"}
    assert path.read_bytes() == source
    assert path_of(b_object.data) == tmp_path / "copy.ply" and path_of(b_second.data) == path
    assert b_object.data.stipple_capture.edits == "" != b_second.data.stipple_capture.edits
    assert b_object.data.stipple_capture.splat_count == splat_count_of(b_object.data) == count
    assert read_splats(tmp_path / "copy.ply").cloud.splat_count == count
    assert np.sqrt(np.mean(np.square(render(tmp_path / "copy.exr") - edited))) < 0.004


def test_a_copy_of_the_selection_leaves_the_object_as_it_is(b_object: Any, path: Path, tmp_path: Path) -> None:
    bpy.ops.stipple.select_sphere(**LEFT)
    token = b_object.data.stipple_capture.edits
    assert bpy.ops.stipple.apply_edits(filepath=str(tmp_path / "copy.ply"), content="SELECTED") == {"FINISHED"}
    assert read_splats(tmp_path / "copy.ply").cloud.splat_count == left_of(path).sum()
    assert path_of(b_object.data) == path and b_object.data.stipple_capture.edits == token


def test_applying_nothing_or_over_the_capture_is_refused(b_object: Any, path: Path, tmp_path: Path) -> None:
    with refused("garden: it has no edits"):
        bpy.ops.stipple.apply_edits(filepath=str(tmp_path / "copy.ply"))
    bpy.ops.stipple.select_all(action="SELECT")
    with refused("this is the capture itself"):
        bpy.ops.stipple.apply_edits(filepath=str(path))
    bpy.ops.stipple.delete()
    with refused("no splats are left"):
        bpy.ops.stipple.apply_edits(filepath=str(tmp_path / "copy.ply"))
    assert not (tmp_path / "copy.ply").exists()
