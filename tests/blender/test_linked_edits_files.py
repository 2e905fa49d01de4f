# SPDX-License-Identifier: GPL-3.0-or-later
"""The files of linked captures' edits beside the .blend: written with it, found with it, and never taken for others."""

from __future__ import annotations

import os
import shutil
from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest

from stipple.addon import edits_beside_blend, linked_edits
from stipple.addon.capture_panel import edits_state_of
from stipple.addon.linked_edits import found_edits
from stipple.engine.edit.edits_file import read_edits

from .captures import in_viewport, pixels_of, random_cloud, render, write_ply
from .editing import activate, refused
from .fresh_process import fresh_python
from .linked import save, synced
from .linked_editing import damage, edited_scene, edits_files, load

pytestmark = pytest.mark.blender

COUNT = 2_000


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return write_ply(tmp_path / "garden.ply", random_cloud(COUNT, degree=1))


@pytest.fixture
def b_object(path: Path) -> Any:
    """A linked capture with edits of every kind, in a scene to be rendered."""
    return edited_scene(path)


def test_saved_and_loaded_they_render_the_same(b_object: Any, tmp_path: Path) -> None:
    before = render(tmp_path / "before.exr")
    save(tmp_path / "shot.blend")
    assert edits_files(tmp_path) == ["shot.garden.edits.npz"]
    token = b_object.data.stipple_capture.edits
    b_object = load(tmp_path / "shot.blend")
    assert not linked_edits._kept and b_object.stipple_editing
    assert np.array_equal(render(tmp_path / "after.exr"), before)
    assert read_edits(tmp_path / "shot.garden.edits.npz").token == token
    assert edits_state_of(b_object.data) == ("Edits: shot.garden.edits.npz", "GREASEPENCIL")
    bpy.ops.stipple.restore()  # and can be edited on
    assert len(synced()) == 2 and synced()[0].states is not None


def test_nothing_of_them_is_in_the_blend_but_a_token(b_object: Any, tmp_path: Path) -> None:
    save(tmp_path / "edited.blend")
    bpy.ops.stipple.discard_edits()
    save(tmp_path / "bare.blend")
    assert abs((tmp_path / "edited.blend").stat().st_size - (tmp_path / "bare.blend").stat().st_size) < 2_000
    assert edits_files(tmp_path) == ["edited.garden.edits.npz"]  # discarding takes no file away


def test_an_unsaved_blend_keeps_them_in_memory_and_says_so(b_object: Any, tmp_path: Path) -> None:
    assert edits_state_of(b_object.data) == ("Edited; saved with the .blend file", "INFO")
    assert edits_files(tmp_path) == [] and len(synced()) == 2


def test_save_as_takes_them_along_and_leaves_the_old_ones(b_object: Any, tmp_path: Path) -> None:
    save(tmp_path / "shot.blend")
    first = (tmp_path / "shot.garden.edits.npz").read_bytes()
    (tmp_path / "shots").mkdir()
    before = render(tmp_path / "before.exr")
    load(tmp_path / "shot.blend")
    save(tmp_path / "shots" / "other.blend")  # without having looked at them
    assert edits_files(tmp_path / "shots") == ["other.garden.edits.npz"]
    assert (tmp_path / "shot.garden.edits.npz").read_bytes() == first
    shutil.move(tmp_path / "shots", tmp_path / "moved")
    load(tmp_path / "moved" / "other.blend")
    assert np.array_equal(render(tmp_path / "after.exr"), before)


def test_a_copy_saved_aside_has_its_own(b_object: Any, tmp_path: Path) -> None:
    save(tmp_path / "shot.blend")
    save(tmp_path / "copy.blend", copy=True)
    bpy.ops.stipple.restore()
    save(tmp_path / "shot.blend")
    shot, copy = (read_edits(tmp_path / f"{name}.garden.edits.npz") for name in ("shot", "copy"))
    assert shot.token != copy.token and copy.counts["deleted"] > shot.counts["deleted"] == 0
    for name, edits in (("shot", shot), ("copy", copy)):
        b_object = load(tmp_path / f"{name}.blend")
        found = found_edits(b_object.data, "garden")
        assert (found.edits.token, found.notice) == (edits.token, "")


def test_saving_again_writes_only_what_changed_and_keeps_one_before(b_object: Any, tmp_path: Path) -> None:
    file = tmp_path / "shot.garden.edits.npz"
    save(tmp_path / "shot.blend")
    first, date = file.read_bytes(), file.stat().st_mtime_ns
    save(tmp_path / "shot.blend")
    assert file.stat().st_mtime_ns == date and edits_files(tmp_path) == [file.name]
    bpy.ops.stipple.restore()
    save(tmp_path / "shot.blend")
    assert file.read_bytes() != first and (tmp_path / f"{file.name}1").read_bytes() == first
    os.replace(tmp_path / "shot.blend1", tmp_path / "shot.blend")  # the .blend of before finds the edits of before
    b_object = load(tmp_path / "shot.blend")
    found = found_edits(b_object.data, "garden")
    assert found.edits.counts["deleted"] > 0 and found.notice == ""


def test_two_objects_of_one_file_have_their_own(b_object: Any, path: Path, tmp_path: Path) -> None:
    b_second = b_object.copy()
    b_second.data = b_object.data.copy()
    bpy.context.scene.collection.objects.link(b_second)
    activate(b_second)
    bpy.ops.stipple.restore()
    save(tmp_path / "shot.blend")
    assert edits_files(tmp_path) == ["shot.garden.edits.npz", "shot.garden_001.edits.npz"]
    load(tmp_path / "shot.blend")
    tokens = {found_edits(b_data, b_data.name).edits.token for b_data in linked_edits.linked_data()}
    assert len(tokens) == 2


@pytest.mark.parametrize("what", ["readable", "damaged"])
def test_datablocks_that_change_names_keep_their_own(b_object: Any, tmp_path: Path, what: str) -> None:
    """In a session that has not looked at the edits yet, and writes each to where the other's are."""
    b_second = b_object.copy()
    b_second.data = b_object.data.copy()
    bpy.context.scene.collection.objects.link(b_second)
    activate(b_second)
    bpy.ops.stipple.restore()
    bpy.context.preferences.filepaths.save_version = 0
    try:
        save(tmp_path / "shot.blend")
        files = [tmp_path / f"shot.{name}.edits.npz" for name in ("garden", "garden_001")]
        if what == "damaged":
            damage(files[0])
        before = [file.read_bytes() for file in files]
        b_first = load(tmp_path / "shot.blend").data
        b_second = next(b_data for b_data in linked_edits.linked_data() if b_data != b_first)
        names = b_first.name, b_second.name
        b_first.name = "other"
        b_second.name, b_first.name = names
        save(tmp_path / "shot.blend")
    finally:
        bpy.context.preferences.filepaths.save_version = 1
    if what == "damaged":
        assert files[1].read_bytes() == before[0]
        assert read_edits(files[0]).counts["deleted"] == 0
    else:
        assert [read_edits(file).counts["deleted"] > 0 for file in files] == [False, True]


@pytest.mark.parametrize("what", ["damaged", "missing"])
def test_a_file_that_is_damaged_or_missing_stops_a_render_and_is_left_alone(
    b_object: Any, tmp_path: Path, what: str
) -> None:
    save(tmp_path / "shot.blend")
    file = tmp_path / "shot.garden.edits.npz"
    damage(file) if what == "damaged" else file.unlink()
    left = file.read_bytes() if file.is_file() else None
    b_object = load(tmp_path / "shot.blend")
    sentence = "the edits are damaged" if what == "damaged" else "there is no such file"
    with refused("shot.garden.edits.npz", sentence):
        render(tmp_path / "after.exr")
    with refused(sentence):
        bpy.ops.stipple.select_all(action="SELECT")
    assert edits_state_of(b_object.data) == (f"Edits: shot.garden.edits.npz is {what}", "ERROR")
    token = b_object.data.stipple_capture.edits
    save(tmp_path / "shot.blend")
    assert (file.read_bytes() if file.is_file() else None) == left
    assert b_object.data.stipple_capture.edits == token
    (tmp_path / "shots").mkdir()
    save(tmp_path / "shots" / "shot.blend")
    other = tmp_path / "shots" / "shot.garden.edits.npz"
    assert (other.read_bytes() if other.is_file() else None) == left
    bpy.ops.stipple.discard_edits()
    assert render(tmp_path / "after.exr").any() and (left is None or file.read_bytes() == left)


def test_a_file_mended_is_found_again_without_a_reload(b_object: Any, tmp_path: Path) -> None:
    before = render(tmp_path / "before.exr")
    save(tmp_path / "shot.blend")
    file = tmp_path / "shot.garden.edits.npz"
    good = file.read_bytes()
    damage(file)
    load(tmp_path / "shot.blend")
    with refused("the edits are damaged"):
        render(tmp_path / "after.exr")
    file.write_bytes(good)
    os.utime(file, ns=(7, 7))
    assert np.array_equal(render(tmp_path / "after.exr"), before)


def test_a_capture_of_other_content_never_gets_them(b_object: Any, path: Path, tmp_path: Path) -> None:
    save(tmp_path / "shot.blend")
    source = path.read_bytes()
    write_ply(path, random_cloud(COUNT, degree=1, seed=9))
    load(tmp_path / "shot.blend")
    with refused(
        "garden.ply: the edits were made on a file of other content; put that file back, or discard the edits"
    ):
        render(tmp_path / "after.exr")
    with refused("of other content"):
        bpy.ops.stipple.select_all(action="SELECT")
    path.write_bytes(source)  # of another date
    assert len(synced()) == 2


def test_a_viewport_shows_the_bare_capture_and_says_why(b_object: Any, tmp_path: Path) -> None:
    save(tmp_path / "shot.blend")
    (tmp_path / "shot.garden.edits.npz").unlink()
    load(tmp_path / "shot.blend")
    instances, warnings = in_viewport()
    assert len(instances) == 1 and instances[0].states is None
    assert "its edits are missing, there is no such file as" in warnings[0]


def test_other_edits_in_the_file_are_shown_with_a_notice(b_object: Any, tmp_path: Path) -> None:
    save(tmp_path / "shot.blend")
    file = tmp_path / "shot.garden.edits.npz"
    bpy.ops.stipple.restore()
    save(tmp_path / "other.blend")
    (tmp_path / "other.garden.edits.npz").replace(file)
    b_object = load(tmp_path / "shot.blend")
    found = found_edits(b_object.data, "garden")
    assert found.notice == (
        "garden: shot.garden.edits.npz holds other edits than the .blend was saved with; they are shown."
    )
    assert found.edits.counts["deleted"] == 0
    save(tmp_path / "shot.blend")  # what is shown is what is saved
    assert found_edits(load(tmp_path / "shot.blend").data, "garden").notice == ""


def test_edits_that_cannot_be_written_are_reported_and_stay_in_memory(
    b_object: Any, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    (tmp_path / "shot.garden.edits.npz").mkdir()
    save(tmp_path / "shot.blend")
    assert "The edits of garden were not saved" in caplog.text and "this is a folder" in caplog.text
    assert edits_state_of(b_object.data) == ("Edits were not saved: see the console", "ERROR")
    assert len(synced()) == 2
    (tmp_path / "shot.garden.edits.npz").rmdir()
    save(tmp_path / "shot.blend")
    assert not edits_beside_blend.problems and edits_files(tmp_path) == ["shot.garden.edits.npz"]


PROGRAM = """
import sys
import bpy
import stipple
stipple.register()
bpy.ops.wm.open_mainfile(filepath=sys.argv[1])
bpy.context.scene.render.filepath = sys.argv[2]
bpy.ops.render.render(write_still=True)
stipple.unregister()
"""


@pytest.mark.slow
def test_another_process_renders_them(b_object: Any, root: Path, tmp_path: Path) -> None:
    before = render(tmp_path / "before.exr")
    save(tmp_path / "shot.blend")
    fresh_python(root, PROGRAM, tmp_path / "shot.blend", tmp_path / "after.exr")
    assert np.array_equal(pixels_of(tmp_path / "after.exr"), before)
