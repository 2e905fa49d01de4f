# SPDX-License-Identifier: GPL-3.0-or-later
"""Sequences of splat files as one object: import, frames in renders and viewports, saving, gaps, memory, threads."""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest

from stipple.addon import residency
from stipple.addon.residency import CloudCache, EvaluatedClouds
from stipple.addon.sequence import SequencePlayer
from stipple.addon.sequence_cache import THREAD_NAME
from stipple.addon.sequence_panel import texts_of
from stipple.addon.splat_data import splat_count_of
from stipple.engine.errors import StippleError
from stipple.engine.formats import read_splats

from .captures import (
    add_camera,
    add_capture,
    assert_same_cloud,
    in_viewport,
    pixels_of,
    random_cloud,
    render,
    use_stipple,
    write_ply,
)
from .numbered import COUNTS, counts, import_sequence, shown, write_numbered

pytestmark = pytest.mark.blender


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return write_numbered(tmp_path)


@pytest.fixture(autouse=True)
def no_thread_is_left() -> Iterator[None]:
    yield
    residency.free()
    assert not [thread for thread in threading.enumerate() if thread.name.startswith(THREAD_NAME)]


def test_import_makes_one_object_that_plays(folder: Path) -> None:
    bpy.context.scene.frame_start = 11
    b_object = import_sequence(folder, 2)
    assert len(bpy.data.objects) == 1 and splat_count_of(b_object.data) == COUNTS[2]
    b_sequence = b_object.stipple_sequence
    assert b_sequence.enabled and b_sequence.frame_start == 11 and b_sequence.loop == "EXTEND"
    assert counts(10, 11, 12, 13, 15, 16) == [30, 30, 50, 40, 20, 20]
    scene, _ = shown(13)
    assert_same_cloud(scene.instances[0].cloud, read_splats(folder / "walk.0003.ply").cloud)
    assert texts_of(b_object, 13) == ("4 files, 1 to 5, 1 missing", "Now walk.0003.ply")
    b_sequence.enabled = False
    assert counts(11, 13) == [COUNTS[2]] * 2


def test_a_selection_of_numbered_files_is_one_sequence(folder: Path) -> None:
    write_ply(folder / "talk7.ply", random_cloud(9))
    files = [{"name": path.name} for path in sorted(folder.glob("*.ply"))]
    bpy.ops.import_scene.splats(files=files, directory=str(folder), sequence=True)
    assert sorted(b_object.name for b_object in bpy.data.objects) == ["talk", "walk"]
    bpy.ops.import_scene.splats(files=files, directory=str(folder))
    assert len(bpy.data.objects) == 2 + len(files)


def test_a_name_without_a_number_is_refused(tmp_path: Path) -> None:
    path = write_ply(tmp_path / "koala.ply", random_cloud(9))
    with pytest.raises(RuntimeError, match="the name has no number"):
        bpy.ops.import_scene.splats(filepath=str(path), sequence=True)
    assert not bpy.data.objects


def test_a_missing_number_holds_the_one_before_and_says_so(folder: Path) -> None:
    import_sequence(folder)
    scene, warnings = shown(4)
    assert scene.splat_count == COUNTS[3]
    assert warnings == ("walk: number 4 of the sequence is missing; walk.0003.ply is held.",)
    assert shown(5)[1] == ()


def test_a_sequence_whose_files_are_gone_takes_no_other_capture_from_the_viewport(folder: Path) -> None:
    import_sequence(folder)
    add_capture(random_cloud(), "Koala")
    for path in folder.glob("*.ply"):
        path.unlink()
    instances, warnings = in_viewport()
    assert [instance.name for instance in instances] == ["Koala"]
    assert "no file of the sequence is there" in warnings[0]
    with pytest.raises(StippleError, match="no file of the sequence is there"):
        shown(1)


def test_the_frame_mapping_is_the_objects(folder: Path) -> None:
    b_sequence = import_sequence(folder).stipple_sequence
    b_sequence.speed = 0.5
    assert counts(1, 2, 3, 4, 5) == [30, 30, 50, 50, 40]
    b_sequence.speed = -1.0
    assert counts(1, 2, 3, 4, 5, 6) == [20, 40, 40, 50, 30, 30]
    b_sequence.speed, b_sequence.loop = 1.0, "CLIP"
    assert counts(0, 1, 5, 6) == [0, 30, 20, 0]
    b_sequence.loop = "REPEAT"
    assert counts(6, 7, 0) == [30, 50, 20]
    b_sequence.loop = "PING_PONG"
    assert counts(6, 7, 9, 10) == [40, 40, 30, 50]
    assert shown(1, 0.9)[0].splat_count == 30


def test_the_offset_can_be_animated_to_retime(folder: Path) -> None:
    b_object = import_sequence(folder)
    b_object.stipple_sequence.speed = 0.0
    for frame, offset in ((1, 0), (2, 4), (3, 1)):
        b_object.stipple_sequence.frame_offset = offset
        b_object.keyframe_insert("stipple_sequence.frame_offset", frame=frame)
    assert counts(1, 2, 3) == [30, 20, 50]


def test_copies_play_apart_and_share_files(folder: Path) -> None:
    b_object = import_sequence(folder)
    b_copy = b_object.copy()
    bpy.context.scene.collection.objects.link(b_copy)
    b_copy.stipple_sequence.frame_start = 2
    first, _ = shown(2)
    assert [instance.cloud.splat_count for instance in first.instances] == [50, 30]
    b_copy.stipple_sequence.frame_start = 1
    same, _ = shown(2)
    assert same.instances[0].cloud is same.instances[1].cloud is first.instances[0].cloud


def test_instances_of_collections_play(folder: Path) -> None:
    b_object = import_sequence(folder)
    b_collection = bpy.data.collections.new("Set")
    b_collection.objects.link(b_object)
    b_empty = bpy.data.objects.new("Instance", None)
    b_empty.instance_type, b_empty.instance_collection = "COLLECTION", b_collection
    bpy.context.scene.collection.objects.link(b_empty)
    assert counts(1, 2, 3) == [60, 100, 80]


def viewport_counts(player: SequencePlayer) -> list[int]:
    class Space:  # a viewport that shows everything; what Blender asks of a real one needs a window
        pass

    b_depsgraph = bpy.context.evaluated_depsgraph_get()
    known = EvaluatedClouds(CloudCache())
    b_shown = [b_instance.object for b_instance in b_depsgraph.object_instances]
    with known.reading(()), player.reading(b_depsgraph.scene):
        clouds = [player.cloud_of(b_object)[0] for b_object in b_shown if b_object.type in ("MESH", "POINTCLOUD")]
    return [0 if cloud is None else cloud.splat_count for cloud in clouds]


def test_a_viewport_notices_frames_and_shows_what_renders_show(folder: Path) -> None:
    import_sequence(folder)
    b_scene = bpy.context.scene
    player = SequencePlayer(residency.sequences, patience=30.0)
    b_scene.frame_set(1)
    assert not player.is_stale(b_scene)  # nothing was read yet: Blender says that there is something new
    for frame in (1, 2, 5, 3):
        b_scene.frame_set(frame)
        assert frame == 1 or player.is_stale(b_scene)
        assert viewport_counts(player) == counts(frame)
        assert not player.is_stale(b_scene)


def test_a_late_file_leaves_the_one_before_and_arrives(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import_sequence(folder)
    gate, arrived = threading.Event(), threading.Event()

    def slow_disk(path: Path) -> Any:
        assert gate.wait(30)
        return read_splats(path)

    monkeypatch.setattr("stipple.addon.sequence_cache.read_splats", slow_disk)
    player = SequencePlayer(residency.sequences, patience=0.01, arrived=arrived.set)
    b_scene = bpy.context.scene
    b_scene.frame_set(1)
    gate.set()
    while viewport_counts(player) != [30]:
        time.sleep(0.01)
    gate.clear()
    arrived.clear()
    residency.sequences.free()
    b_scene.frame_set(2)
    assert viewport_counts(player) == [30]
    assert player.warnings == ("walk: reading walk.0002.ply",) and not player.is_stale(b_scene)
    gate.set()
    assert arrived.wait(30) and player.is_stale(b_scene)
    assert viewport_counts(player) == [50] and player.warnings == ()


@pytest.mark.parametrize("method", ["SORTED", "POINTS"])
def test_renders_of_frames_are_those_of_the_files(folder: Path, tmp_path: Path, method: str) -> None:
    b_scene = use_stipple(method=method)
    add_camera()
    b_object = import_sequence(folder)
    b_scene.frame_start, b_scene.frame_end = 1, 3
    b_scene.render.image_settings.file_format = "PNG"
    b_scene.render.filepath = str(tmp_path / "out") + os.sep
    bpy.ops.render.render(animation=True)
    animated = [pixels_of(path) for path in sorted((tmp_path / "out").glob("*.png"))]
    bpy.data.objects.remove(b_object)
    assert len(animated) == 3
    for number, frame in enumerate(animated, 1):
        b_still = add_capture(read_splats(folder / f"walk.{number:04d}.ply").cloud)
        b_scene.frame_set(number)
        assert frame[..., :3].max() > 0.2
        np.testing.assert_array_equal(frame, render(tmp_path / "still.png"))
        bpy.data.objects.remove(b_still)


def test_a_damaged_file_stops_with_its_name_and_can_be_replaced(folder: Path) -> None:
    import_sequence(folder)
    good = (folder / "walk.0002.ply").read_bytes()
    (folder / "walk.0002.ply").write_bytes(good[:-10])
    assert counts(1) == [30]  # and reads ahead in vain
    with pytest.raises(StippleError, match=r"walk\.0002\.ply"):
        shown(2)
    assert counts(3) == [40]
    (folder / "walk.0002.ply").write_bytes(good)
    assert counts(2) == [50]


def test_files_that_appear_are_found(folder: Path) -> None:
    import_sequence(folder)
    assert counts(4, 6) == [40, 20]
    for number in (4, 6):
        write_ply(folder / f"walk.{number:04d}.ply", random_cloud(60 + number))
    assert counts(4, 6) == [64, 66]


def test_the_next_files_are_read_ahead(folder: Path) -> None:
    import_sequence(folder)
    shown(1)
    futures = residency.sequences._files
    assert sorted(key[0].name for key in futures) == [f"walk.000{number}.ply" for number in (1, 2, 3)]
    read_ahead = {key[0].name: future.result(30).cloud for key, future in futures.items()}
    scene, _ = shown(2)
    assert scene.instances[0].cloud is read_ahead["walk.0002.ply"]
