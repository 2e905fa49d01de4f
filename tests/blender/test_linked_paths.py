# SPDX-License-Identifier: GPL-3.0-or-later
"""The files of linked captures: how their paths follow the .blend file, and what happens when they are gone."""

from __future__ import annotations

import os
import shutil
from pathlib import Path

import bpy
import pytest

from stipple.addon.capture_panel import facts_of, state_of
from stipple.addon.linked_capture import is_linked, path_of
from stipple.addon.splat_data import splat_count_of
from stipple.engine.capture_file import CaptureFile

from .captures import add_camera, random_cloud, render, use_stipple, write_ply
from .linked import broken, link, save, synced

pytestmark = pytest.mark.blender


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return write_ply(tmp_path / "garden.ply", random_cloud(300, degree=2))


def test_packing_and_purging_leave_the_file_alone(path: Path, tmp_path: Path) -> None:
    before = path.read_bytes()
    link(path)
    bpy.ops.file.pack_all()
    bpy.ops.outliner.orphans_purge(do_recursive=True)
    save(tmp_path / "scene.blend")
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "scene.blend"))
    assert path_of(bpy.data.objects["garden"].data) == path
    assert path.read_bytes() == before


def test_paths_are_relative_and_follow_the_blend_file(path: Path, tmp_path: Path) -> None:
    save(tmp_path / "scene.blend")
    b_object = link("//garden.ply")
    b_file = b_object.data.stipple_capture.file
    assert b_file.filepath == "//garden.ply"
    (tmp_path / "shots").mkdir()
    save(tmp_path / "shots" / "shot.blend")
    assert b_file.filepath == "//../garden.ply" and path_of(b_object.data) == path
    shutil.copytree(tmp_path, tmp_path.parent / "moved")
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path.parent / "moved" / "shots" / "shot.blend"))
    (instance,) = synced()
    assert instance.cloud.path == tmp_path.parent / "moved" / "garden.ply"


def test_a_path_of_an_unsaved_file_is_absolute_until_made_relative(path: Path, tmp_path: Path) -> None:
    b_object = link(path)
    assert b_object.data.stipple_capture.file.filepath == str(path)
    save(tmp_path / "scene.blend")
    bpy.ops.file.make_paths_relative()
    assert b_object.data.stipple_capture.file.filepath == "//garden.ply"
    bpy.ops.file.make_paths_absolute()
    assert path_of(b_object.data) == path


def test_objects_appended_and_linked_from_another_blend_file_find_the_capture(path: Path, tmp_path: Path) -> None:
    (tmp_path / "library").mkdir()
    save(tmp_path / "library" / "library.blend")
    link(path)
    save(tmp_path / "library" / "library.blend")
    for linked in (False, True):
        bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
        save(tmp_path / f"shot{linked}.blend")
        with bpy.data.libraries.load(str(tmp_path / "library" / "library.blend"), link=linked, relative=True) as (
            _,
            to,
        ):
            to.objects = ["garden"]
        bpy.context.scene.collection.objects.link(to.objects[0])
        (instance,) = synced()
        assert isinstance(instance.cloud, CaptureFile) and instance.cloud.path == path


def test_a_final_render_of_a_missing_file_stops_and_names_it(path: Path, tmp_path: Path) -> None:
    add_camera()
    use_stipple()
    link(path)
    broken(path)
    with pytest.raises(RuntimeError, match=r"garden: the linked file .*garden\.ply is missing; choose the file in"):
        render(tmp_path / "picture.png")
    assert not (tmp_path / "picture.png").exists()


def test_hidden_from_renders_it_may_be_missing(path: Path, tmp_path: Path) -> None:
    add_camera()
    use_stipple()
    link(path).hide_render = True
    broken(path)
    assert render(tmp_path / "picture.png").shape == (48, 64, 4)


def test_blender_finds_missing_files(path: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    save(tmp_path / "scene.blend")
    b_object = link(path)
    away = broken(path)
    assert state_of(b_object.data) == ("The file is missing", "ERROR")
    bpy.ops.file.report_missing_files()
    printed = capfd.readouterr()
    assert "garden.ply" in printed.out + printed.err
    bpy.ops.file.find_missing_files(directory=str(tmp_path))
    assert path_of(b_object.data) == away
    (instance,) = synced()
    assert instance.cloud.path == away


def test_relinking_finds_the_others_in_the_same_folder(tmp_path: Path) -> None:
    paths = [write_ply(tmp_path / f"part{i}.ply", random_cloud(50 + i, seed=i)) for i in range(3)]
    b_objects = [link(path) for path in paths]
    away = [broken(path) for path in paths[:2]]
    write_ply(away[0], random_cloud(77))  # another version of it
    bpy.context.view_layer.objects.active = b_objects[0]
    assert bpy.ops.object.stipple_relink_capture(filepath=str(away[0])) == {"FINISHED"}
    assert [path_of(b_object.data) for b_object in b_objects] == [*away, paths[2]]
    assert [b_object.data.stipple_capture.splat_count for b_object in b_objects] == [77, 51, 52]
    assert splat_count_of(b_objects[0].data) == 77
    assert {instance.cloud.splat_count for instance in synced()} == {77, 51, 52}


@pytest.mark.parametrize("content", [None, b"not a capture"])
def test_relinking_to_what_is_no_capture_changes_nothing(path: Path, tmp_path: Path, content: bytes | None) -> None:
    b_object = link(path)
    other = tmp_path / "other.ply"
    if content is not None:
        other.write_bytes(content)
    with pytest.raises(RuntimeError, match=r"other\.ply"):
        bpy.ops.object.stipple_relink_capture(filepath=str(other))
    assert path_of(b_object.data) == path and splat_count_of(b_object.data) == 300


def test_a_link_whose_datablock_was_deleted_is_missing_and_can_be_relinked(path: Path, tmp_path: Path) -> None:
    add_camera()
    use_stipple()
    b_object = link(path)
    bpy.data.batch_remove([b_object.data.stipple_capture.file])
    assert is_linked(b_object.data) and state_of(b_object.data)[1] == "ERROR"
    with pytest.raises(RuntimeError, match="the link to its file was deleted"):
        render(tmp_path / "picture.png")
    with pytest.raises(RuntimeError, match="deleted"):
        bpy.ops.object.stipple_reload_capture()
    bpy.ops.object.stipple_relink_capture(filepath=str(path))
    assert synced()[0].cloud.path == path


def test_a_file_that_changed_is_rendered_as_it_is_and_reload_updates_the_points(path: Path) -> None:
    b_object = link(path)
    assert state_of(b_object.data)[1] == "LINKED"
    before = synced()[0].cloud
    write_ply(path, random_cloud(120, degree=1))
    os.utime(path, ns=(1, 1))
    after = synced()[0].cloud
    assert after is not before and after.splat_count == 120
    assert "Changed on disk" in state_of(b_object.data)[0] and splat_count_of(b_object.data) == 300
    assert bpy.ops.object.stipple_reload_capture() == {"FINISHED"}
    assert splat_count_of(b_object.data) == 120 and state_of(b_object.data)[1] == "LINKED"
    assert facts_of(b_object.data)[0] == "120 splats, SH degree 1"


def test_undo_and_redo_of_linking_and_relinking(path: Path, tmp_path: Path) -> None:
    other = write_ply(tmp_path / "other.ply", random_cloud(40))
    bpy.ops.ed.undo_push(message="Before")
    link(path)
    bpy.ops.ed.undo_push(message="Linked")
    bpy.ops.object.stipple_relink_capture(filepath=str(other))
    bpy.ops.ed.undo_push(message="Relinked")
    bpy.ops.ed.undo()
    assert path_of(bpy.data.objects["garden"].data) == path
    assert splat_count_of(bpy.data.objects["garden"].data) == 300
    bpy.ops.ed.undo()
    assert "garden" not in bpy.data.objects and not bpy.data.cache_files
    bpy.ops.ed.redo()
    bpy.ops.ed.redo()
    assert synced()[0].cloud.path == other


def test_one_file_linked_twice_has_one_path(path: Path) -> None:
    one, two = link(path), link(path)
    assert one.data != two.data and one.data.stipple_capture.file == two.data.stipple_capture.file
    assert len(bpy.data.cache_files) == 1
