# SPDX-License-Identifier: GPL-3.0-or-later
"""File > Export > Gaussian Splats: all, selected and edited captures, read back."""

from __future__ import annotations

from pathlib import Path

import bpy
import numpy as np
import pytest
from mathutils import Euler, Matrix

from stipple.addon.splat_data import write_states
from stipple.engine.edit.state_bits import HIDDEN, LOCKED, SELECTED
from stipple.engine.edit.transform import transform_cloud
from stipple.engine.formats import read_splats

from .captures import add_camera, add_capture, random_cloud, render, use_stipple
from .editing import activate, assert_close, cloud_of, edited, flags, part, refused
from .numbered import import_sequence, write_numbered

pytestmark = pytest.mark.blender
NAMED = {10: "Koala.001", 20: "Koala_001", 30: "koala", 40: "Koala"}  # by splat count
PLACED = Matrix.LocRotScale((1, 2, -3), Euler((0.3, -0.5, 1.1)), (1.5, 1.5, 1.5))


def test_export_writes_what_is_seen(tmp_path: Path) -> None:
    b_object = edited()
    b_object.matrix_world = PLACED
    bpy.context.view_layer.update()
    before = cloud_of(b_object)
    bpy.ops.stipple.select_sphere(center=(1, 2, -3), radius=1.2)
    chosen = flags(b_object, SELECTED)
    assert 10 < chosen.sum() < 190
    path = tmp_path / "selected.ply"
    bpy.ops.export_scene.splats(filepath=str(path), content="SPLATS", apply_transform=False)
    assert_close(read_splats(path).cloud, part(before, chosen))
    bpy.ops.stipple.delete()
    path = tmp_path / "rest.ply"
    bpy.ops.export_scene.splats(filepath=str(path))
    rest = part(before, ~chosen)
    assert_close(read_splats(path).cloud, transform_cloud(rest, np.array(PLACED)[:3]), 1e-5)


def test_selected_splats_that_are_hidden_or_locked_are_not_exported(tmp_path: Path) -> None:
    """Hiding and locking keep the selection's flag, for a reveal brings it back; no edit acts on such splats."""
    b_object = edited(random_cloud(40))
    bpy.ops.stipple.select_all(action="SELECT")
    states = np.full(40, SELECTED, np.uint32)
    states[:10] |= HIDDEN
    states[10:20] |= LOCKED
    write_states(b_object.data, states)
    path = tmp_path / "selected.ply"
    bpy.ops.export_scene.splats(filepath=str(path), content="SPLATS", apply_transform=False)
    assert_close(read_splats(path).cloud, part(cloud_of(b_object), np.arange(20, 40)))


def test_export_of_several_objects(tmp_path: Path) -> None:
    b_one, b_two = add_capture(random_cloud(degree=0), "One"), add_capture(random_cloud(degree=2, seed=2), "Two")
    activate(b_one)
    bpy.ops.export_scene.splats(filepath=str(tmp_path / "all.ply"), content="VISIBLE")
    merged = read_splats(tmp_path / "all.ply").cloud
    assert merged.splat_count == 400 and merged.sh_degree == 2
    b_two.select_set(True)
    bpy.ops.export_scene.splats(filepath=str(tmp_path / "each.ply"), per_object=True)
    assert_close(read_splats(tmp_path / "each_Two.ply").cloud, cloud_of(b_two))
    assert_close(read_splats(tmp_path / "each_One.ply").cloud, cloud_of(b_one))


def test_files_per_object_have_names_of_their_own(tmp_path: Path) -> None:
    """Names that are one as a file's, and one object alone."""
    b_objects = [add_capture(random_cloud(count, seed=count), name) for count, name in NAMED.items()]
    for b_object in b_objects:
        b_object.select_set(True)
    bpy.ops.export_scene.splats(filepath=str(tmp_path / "out.ply"), per_object=True)
    found = {path.name: read_splats(path).cloud.splat_count for path in tmp_path.iterdir()}
    assert len({name.lower() for name in found}) == 4 and sorted(found.values()) == sorted(NAMED)
    assert {"out_Koala_001.ply", "out_Koala_001.001.ply"} < set(found)
    activate(b_objects[0])
    bpy.ops.export_scene.splats(filepath=str(tmp_path / "one.ply"), per_object=True)
    assert read_splats(tmp_path / "one_Koala_001.ply").cloud.splat_count == 10
    assert not (tmp_path / "one.ply").exists()


def test_no_file_is_replaced_where_one_of_them_cannot_be_written(tmp_path: Path) -> None:
    for name in ("A", "B"):
        add_capture(random_cloud(), name).select_set(True)
    (tmp_path / "out_A.ply").write_bytes(b"old")
    (tmp_path / "out_B.ply").mkdir()
    with refused("out_B.ply", "folder"):
        bpy.ops.export_scene.splats(filepath=str(tmp_path / "out.ply"), per_object=True)
    assert (tmp_path / "out_A.ply").read_bytes() == b"old"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["out_A.ply", "out_B.ply"]


def test_a_sequence_is_exported_as_it_is_shown_and_not_joined(tmp_path: Path) -> None:
    b_object = import_sequence(write_numbered(tmp_path))
    bpy.context.scene.frame_set(3)
    path = tmp_path / "shown.ply"
    bpy.ops.export_scene.splats(filepath=str(path))
    assert_close(read_splats(path).cloud, read_splats(tmp_path / "walk" / "walk.0003.ply").cloud)
    b_object.stipple_sequence.loop = "CLIP"
    bpy.context.scene.frame_set(30)
    for content in ("SELECTED", "SPLATS"):
        with refused("no capture with such splats"):
            bpy.ops.export_scene.splats(filepath=str(tmp_path / "none.ply"), content=content)
    b_other = add_capture(random_cloud(), "Other")
    b_other.select_set(True)
    for b_active in (b_object, b_other):
        bpy.context.view_layer.objects.active = b_active
        with refused("walk", "plays a sequence", "join"):
            bpy.ops.stipple.join()
    assert set(bpy.data.objects) == {b_object, b_other}


def test_export_says_what_is_wrong_and_writes_nothing(tmp_path: Path) -> None:
    edited()
    with refused("no capture with such splats"):
        bpy.ops.export_scene.splats(filepath=str(tmp_path / "none.ply"), content="SPLATS")
    with refused("missing", "folder"):
        bpy.ops.export_scene.splats(filepath=str(tmp_path / "missing" / "none.ply"))
    assert list(tmp_path.iterdir()) == []


def test_an_exported_capture_looks_the_same(tmp_path: Path) -> None:
    """The object's transform is in the file, its view-dependent colour turned."""
    use_stipple(48, 36)
    add_camera()
    b_object = add_capture(random_cloud(degree=3))
    b_object.matrix_world = Matrix.LocRotScale((0.1, 0.2, 0), Euler((0.4, 0.2, 2.0)), (0.9, 0.9, 0.9))
    activate(b_object)
    before = render(tmp_path / "object.exr")
    bpy.ops.export_scene.splats(filepath=str(tmp_path / "out.ply"))
    bpy.data.objects.remove(b_object)
    bpy.ops.import_scene.splats(filepath=str(tmp_path / "out.ply"), up_axis="Z")
    assert np.abs(render(tmp_path / "file.exr") - before).max() < 2e-3
