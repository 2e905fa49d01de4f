# SPDX-License-Identifier: GPL-3.0-or-later
"""bpy.ops.import_scene.splats: objects, axes, several files, messages, undo."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest

from stipple.addon.operators.import_splats import IMPORT_SCENE_OT_splats, IO_FH_stipple_splats
from stipple.addon.splat_data import SOURCE_PROPERTY, cloud_from_datablock, is_capture, splat_count_of
from stipple.engine.formats import read_splats

from .captures import assert_same_cloud, random_cloud, write_ply

pytestmark = pytest.mark.blender

MESH_PLY = """ply
format ascii 1.0
element vertex 3
property float x
property float y
property float z
element face 1
property list uchar int vertex_indices
end_header
0 0 0
1 0 0
0 1 0
3 0 1 2
"""


def datablock_count() -> int:
    return len(bpy.data.objects) + len(bpy.data.meshes) + len(bpy.data.pointclouds)


def test_the_file_becomes_an_active_selected_object(tmp_path: Path) -> None:
    path = write_ply(tmp_path / "statue.ply", random_cloud(degree=3))
    b_other = bpy.data.objects.new("Other", None)
    bpy.context.scene.collection.objects.link(b_other)
    b_other.select_set(True)
    engine = bpy.context.scene.render.engine
    assert bpy.ops.import_scene.splats(filepath=str(path)) == {"FINISHED"}
    b_object = bpy.data.objects["statue"]
    assert bpy.context.view_layer.objects.active == b_object
    assert list(bpy.context.view_layer.objects.selected) == [b_object]
    assert b_object.name in bpy.context.collection.objects
    assert b_object.data[SOURCE_PROPERTY] == str(path)
    assert bpy.context.scene.render.engine == engine
    cloud, dropped = cloud_from_datablock(b_object.data, "statue")
    assert cloud is not None and dropped == 0
    assert_same_cloud(cloud, read_splats(path).cloud)


@pytest.mark.parametrize(
    ("up_axis", "up"),
    [
        ("X", (1, 0, 0)),
        ("Y", (0, 1, 0)),
        ("Z", (0, 0, 1)),
        ("NEGATIVE_X", (-1, 0, 0)),
        ("NEGATIVE_Y", (0, -1, 0)),
        ("NEGATIVE_Z", (0, 0, -1)),
    ],
)
def test_the_up_axis_turns_the_object_only(tmp_path: Path, up_axis: str, up: tuple[int, int, int]) -> None:
    path = write_ply(tmp_path / "statue.ply", random_cloud())
    bpy.ops.import_scene.splats(filepath=str(path), up_axis=up_axis)
    bpy.context.view_layer.update()
    b_object = bpy.data.objects["statue"]
    linear = np.array(b_object.matrix_world)[:3, :3]
    np.testing.assert_allclose(linear @ up, (0, 0, 1), atol=1e-6)
    assert np.linalg.det(linear) == pytest.approx(1)
    cloud, _ = cloud_from_datablock(b_object.data, "statue")
    assert cloud is not None
    assert_same_cloud(cloud, read_splats(path).cloud)


def test_captures_stand_upright_by_default(tmp_path: Path) -> None:
    bpy.ops.import_scene.splats(filepath=str(write_ply(tmp_path / "statue.ply", random_cloud())))
    bpy.context.view_layer.update()
    linear = np.array(bpy.data.objects["statue"].matrix_world)[:3, :3]
    np.testing.assert_allclose(linear @ (0, -1, 0), (0, 0, 1), atol=1e-6)
    np.testing.assert_allclose(linear @ (0, 0, 1), (0, 1, 0), atol=1e-6)  # COLMAP's forward is Blender's


def test_several_files_at_once(tmp_path: Path) -> None:
    for index in range(3):
        write_ply(tmp_path / f"part{index}.ply", random_cloud(50 + index, seed=index))
    files = [{"name": f"part{index}.ply"} for index in range(3)]
    bpy.ops.import_scene.splats(directory=str(tmp_path), files=files)
    assert [splat_count_of(bpy.data.objects[f"part{index}"].data) for index in range(3)] == [50, 51, 52]
    assert len(bpy.context.view_layer.objects.selected) == 3


def test_one_bad_file_does_not_stop_the_others(tmp_path: Path) -> None:
    write_ply(tmp_path / "good.ply", random_cloud())
    (tmp_path / "bad.ply").write_text(MESH_PLY)
    with pytest.raises(RuntimeError, match=r"bad\.ply"):
        bpy.ops.import_scene.splats(directory=str(tmp_path), files=[{"name": "bad.ply"}, {"name": "good.ply"}])
    assert [b_object.name for b_object in bpy.data.objects] == ["good"]


@pytest.mark.parametrize("content", [None, "", MESH_PLY, "not a ply at all\n"])
def test_a_file_that_cannot_be_read_leaves_nothing(tmp_path: Path, content: str | None) -> None:
    path = tmp_path / "broken.ply"
    if content is not None:
        path.write_text(content)
    before = datablock_count()
    with pytest.raises(RuntimeError, match=r"broken\.ply") as caught:
        bpy.ops.import_scene.splats(filepath=str(path))
    assert "Traceback" not in str(caught.value)
    assert len(str(caught.value).strip().splitlines()) == 1
    assert datablock_count() == before


def test_a_truncated_file_leaves_nothing(tmp_path: Path) -> None:
    path = write_ply(tmp_path / "broken.ply", random_cloud())
    path.write_bytes(path.read_bytes()[:-100])
    before = datablock_count()
    with pytest.raises(RuntimeError, match=r"broken\.ply"):
        bpy.ops.import_scene.splats(filepath=str(path))
    assert datablock_count() == before


def test_dropped_splats_are_reported(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    cloud = random_cloud()
    cloud.position[:4, 0] = np.nan
    bpy.ops.import_scene.splats(filepath=str(write_ply(tmp_path / "statue.ply", cloud)))
    assert splat_count_of(bpy.data.objects["statue"].data) == cloud.splat_count - 4
    printed = capfd.readouterr()
    warnings = [line for line in (printed.out + printed.err).splitlines() if line.startswith("Warning")]
    assert len(warnings) == 1 and "4" in warnings[0] and "statue.ply" in warnings[0]


def test_undo_and_redo(tmp_path: Path) -> None:
    cloud = random_cloud()
    path = write_ply(tmp_path / "statue.ply", cloud)
    bpy.ops.ed.undo_push(message="Before")
    bpy.ops.import_scene.splats(filepath=str(path))
    bpy.ops.ed.undo_push(message="Imported")
    bpy.data.objects["statue"].location.x = 5
    bpy.ops.ed.undo_push(message="Moved")
    bpy.ops.ed.undo()
    assert bpy.data.objects["statue"].location.x == 0
    read, _ = cloud_from_datablock(bpy.data.objects["statue"].data, "statue")
    assert read is not None
    assert_same_cloud(read, read_splats(path).cloud)
    bpy.ops.ed.undo()
    assert "statue" not in bpy.data.objects
    bpy.ops.ed.redo()
    read, _ = cloud_from_datablock(bpy.data.objects["statue"].data, "statue")
    assert read is not None
    assert_same_cloud(read, read_splats(path).cloud)


def test_relative_paths_follow_the_blend_file(tmp_path: Path) -> None:
    write_ply(tmp_path / "statue.ply", random_cloud())
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "scene.blend"))
    bpy.ops.import_scene.splats(filepath="//statue.ply")
    assert "statue" in bpy.data.objects


def test_files_can_be_dropped() -> None:
    b_handlers: list[Any] = bpy.types.FileHandler.__subclasses__()
    assert IO_FH_stipple_splats in b_handlers and IO_FH_stipple_splats.is_registered
    assert IO_FH_stipple_splats.bl_import_operator == IMPORT_SCENE_OT_splats.bl_idname
    assert {"filepath", "directory", "files"} <= set(bpy.ops.import_scene.splats.get_rna_type().properties.keys())


@pytest.mark.real
def test_a_real_capture(koala_path: Path) -> None:
    bpy.ops.import_scene.splats(filepath=str(koala_path))
    b_object = bpy.context.view_layer.objects.active
    assert is_capture(b_object.data)
    cloud, dropped = cloud_from_datablock(b_object.data, "koala")
    assert cloud is not None and dropped == 0
    assert_same_cloud(cloud, read_splats(koala_path).cloud)
