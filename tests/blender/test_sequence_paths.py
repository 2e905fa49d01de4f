# SPDX-License-Identifier: GPL-3.0-or-later
"""Where the files of a sequence are: .blend files that move, are saved elsewhere or linked, and wrong paths."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import bpy
import pytest

from stipple.addon.sequence_panel import texts_of

from .captures import add_camera, render, use_stipple
from .numbered import counts, import_sequence, write_numbered

pytestmark = pytest.mark.blender


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return write_numbered(tmp_path)


def test_relative_paths_follow_the_file(folder: Path, tmp_path: Path) -> None:
    blend = tmp_path / "scene.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(blend))
    import_sequence(folder)
    assert bpy.context.view_layer.objects.active.stipple_sequence.filepath == "//walk/walk.0001.ply"
    bpy.ops.wm.save_mainfile()
    moved = tmp_path / "moved"
    moved.mkdir()
    shutil.move(str(folder), str(moved / "walk"))
    shutil.move(str(blend), str(moved / "scene.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(moved / "scene.blend"))
    assert counts(1, 2, 3) == [30, 50, 40]


def test_saving_elsewhere_keeps_the_sequence_and_a_copy_moves_nothing(folder: Path, tmp_path: Path) -> None:
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "scene.blend"))
    b_sequence = import_sequence(folder).stipple_sequence
    for name in ("copies", "deep/er"):
        (tmp_path / name).mkdir(parents=True)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "copies" / "copy.blend"), copy=True)
    assert b_sequence.filepath == "//walk/walk.0001.ply" and counts(2) == [50]
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "deep" / "er" / "scene.blend"))
    assert b_sequence.filepath == "//../../walk/walk.0001.ply"
    for blend in ("copies/copy.blend", "deep/er/scene.blend"):
        bpy.ops.wm.open_mainfile(filepath=str(tmp_path / blend))
        assert counts(1, 2) == [30, 50]


def asset_of(folder: Path) -> tuple[Path, str]:
    """A saved .blend beside the folder and its object that plays; open afterwards is one in another folder."""
    blend = folder.parent / "asset.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(blend))
    name = import_sequence(folder).name
    bpy.ops.wm.save_mainfile()
    open_shot(folder)
    return blend, name


def open_shot(folder: Path) -> None:
    (folder.parent / "shots").mkdir()
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    bpy.ops.wm.save_as_mainfile(filepath=str(folder.parent / "shots" / "shot.blend"))


def bring(blend: Path, name: str, link: bool) -> Any:
    """The object, linked or appended, in the open file's scene."""
    with bpy.data.libraries.load(str(blend), link=link) as (_, wanted):
        wanted.objects = [name]
    bpy.context.scene.collection.objects.link(wanted.objects[0])
    return wanted.objects[0]


def test_a_linked_object_plays_beside_its_own_file_and_here_once_local(folder: Path) -> None:
    b_object = bring(*asset_of(folder), link=True)
    assert counts(1, 2) == [30, 50]
    b_object.make_local()
    assert counts(1, 2) == [30, 50]
    bpy.ops.wm.save_mainfile()
    bpy.ops.wm.open_mainfile(filepath=bpy.data.filepath)
    assert counts(1, 2) == [30, 50]


@pytest.mark.parametrize("moved", [False, True])
def test_an_appended_object_plays_the_files_beside_its_own_file(folder: Path, moved: bool) -> None:
    blend, name = asset_of(folder)
    if moved:
        place = folder.parent / "moved"
        place.mkdir()
        shutil.move(str(folder), str(place / "walk"))
        blend = Path(shutil.move(str(blend), str(place / "asset.blend")))
    b_object = bring(blend, name, link=False)
    assert b_object.stipple_sequence.filepath == ("//../moved" if moved else "//..") + "/walk/walk.0001.ply"
    assert counts(1, 2) == [30, 50]


def test_a_pasted_object_plays_what_the_copied_one_did(folder: Path) -> None:
    bpy.ops.wm.save_as_mainfile(filepath=str(folder.parent / "asset.blend"))
    import_sequence(folder).select_set(True)
    bpy.ops.view3d.copybuffer()
    open_shot(folder)
    bpy.ops.view3d.pastebuffer()
    assert counts(1, 2) == [30, 50]


def test_an_override_plays_the_files_beside_the_library_as_it_says(folder: Path) -> None:
    """Saved to several folders, with a speed of its own."""
    bring(*asset_of(folder), link=True).override_create(remap_local_usages=True).stipple_sequence.speed = 2.0
    assert counts(1, 2) == [30, 40]
    bpy.ops.wm.save_mainfile()
    for place in (folder.parent, folder.parent / "deep" / "er"):
        place.mkdir(parents=True, exist_ok=True)
        bpy.ops.wm.open_mainfile(filepath=bpy.data.filepath)
        assert counts(1, 2) == [30, 40]
        bpy.ops.wm.save_as_mainfile(filepath=str(place / "shot.blend"))
        assert counts(1, 2) == [30, 40]


def test_a_file_chosen_on_an_override_is_this_files(folder: Path) -> None:
    b_override = bring(*asset_of(folder), link=True).override_create(remap_local_usages=True)
    shutil.copytree(folder, folder.parent / "shots" / "own")
    (folder.parent / "shots" / "own" / "walk.0001.ply").unlink()
    b_override.stipple_sequence.filepath = "//own/walk.0002.ply"
    assert counts(1, 2) == [50, 40]
    bpy.ops.wm.save_mainfile()
    bpy.ops.wm.open_mainfile(filepath=bpy.data.filepath)
    assert counts(1, 2) == [50, 40]


def test_undo_after_saving_elsewhere_keeps_the_sequence(folder: Path) -> None:
    bpy.ops.wm.save_as_mainfile(filepath=str(folder.parent / "scene.blend"))
    name = import_sequence(folder).name
    bpy.ops.ed.undo_push(message="imported")
    bpy.data.objects[name].location.x = 1
    bpy.ops.ed.undo_push(message="moved")
    (folder.parent / "else").mkdir()
    bpy.ops.wm.save_as_mainfile(filepath=str(folder.parent / "else" / "scene.blend"))
    for step in (bpy.ops.ed.undo, bpy.ops.ed.redo):
        step()
        assert bpy.data.objects[name].stipple_sequence.filepath == "//../walk/walk.0001.ply"
        assert counts(1, 2) == [30, 50]


@pytest.mark.parametrize(
    ("filepath", "sentence"),
    [
        ("", "walk: the sequence has no file; choose one in Object properties > Splat Sequence"),
        ("//walk.1.ply", "relative to a file that was never saved"),
        ("/nowhere/walk.1.ply", "the folder of the sequence cannot be read"),
    ],
)
def test_what_is_wrong_with_the_file_is_said(folder: Path, tmp_path: Path, filepath: str, sentence: str) -> None:
    use_stipple()
    add_camera()
    b_object = import_sequence(folder)
    b_object.stipple_sequence.filepath = filepath
    with pytest.raises(RuntimeError, match=sentence):
        render(tmp_path / "failed.png")
    assert not list(tmp_path.glob("failed*"))
    assert sentence in texts_of(b_object, 1)[0]
