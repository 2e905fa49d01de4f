# SPDX-License-Identifier: GPL-3.0-or-later
"""Where the files of a sequence are: .blend files that move, are saved elsewhere or linked, and wrong paths."""

from __future__ import annotations

import shutil
from pathlib import Path

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


def test_a_linked_object_plays_beside_its_own_file(folder: Path, tmp_path: Path) -> None:
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "asset.blend"))
    name = import_sequence(folder).name
    bpy.ops.wm.save_mainfile()
    (tmp_path / "shots").mkdir()
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "shots" / "shot.blend"))
    with bpy.data.libraries.load(str(tmp_path / "asset.blend"), link=True) as (_, wanted):
        wanted.objects = [name]
    bpy.context.scene.collection.objects.link(wanted.objects[0])
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
