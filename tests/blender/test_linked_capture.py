# SPDX-License-Identifier: GPL-3.0-or-later
"""Captures that stay in their file: what the .blend keeps, and what is rendered."""

from __future__ import annotations

from pathlib import Path

import bpy
import numpy as np
import pytest

from stipple.addon import linked_capture, preferences, residency
from stipple.addon.capture_panel import DATA_PT_stipple_linked_capture
from stipple.addon.linked_capture import is_linked, path_of
from stipple.addon.residency import CloudCache
from stipple.addon.splat_data import is_capture, splat_count_of
from stipple.addon.sync import scene_from_depsgraph
from stipple.engine.capture_file import CaptureFile
from stipple.engine.formats import read_splats
from stipple.engine.splats import SplatCloud
from tests.capture_files import write_large

from .captures import add_camera, add_capture, in_viewport, random_cloud, render, use_stipple, write_ply
from .geometry_nodes import node_tree
from .linked import link, save, synced

pytestmark = pytest.mark.blender


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return write_ply(tmp_path / "garden.ply", random_cloud(300, degree=2))


def test_a_linked_object_shows_a_proxy_and_knows_its_file(path: Path) -> None:
    b_object = link(path)
    b_capture = b_object.data.stipple_capture
    cloud = read_splats(path).cloud
    assert is_capture(b_object.data) and is_linked(b_object.data) and path_of(b_object.data) == path
    assert (b_capture.splat_count, b_capture.sh_degree) == (300, 2)
    np.testing.assert_allclose((b_capture.bounds_low, b_capture.bounds_high), cloud.bounds, rtol=1e-6)
    assert splat_count_of(b_object.data) == 300
    bpy.context.view_layer.update()
    np.testing.assert_allclose(np.min(b_object.bound_box, axis=0), cloud.bounds[0], atol=0.2)
    assert "stipple_source" not in b_object.data
    assert not is_linked(add_capture(random_cloud()).data)


def test_what_is_rendered_is_the_file_and_not_the_proxy(path: Path) -> None:
    b_object = link(path)
    b_object.location, b_object.pass_index = (1, 2, 3), 7
    (instance,) = synced()
    assert isinstance(instance.cloud, CaptureFile) and instance.cloud.path == path
    assert (instance.name, instance.object_index) == ("garden", 7)
    assert np.array_equal(instance.world_from_object[:, 3], (1, 2, 3))


def rms(difference: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.square(difference))))


@pytest.mark.parametrize("method", ["SORTED", "POINTS"])
def test_the_picture_is_that_of_the_imported_capture(tmp_path: Path, method: str) -> None:
    """But for what quantisation takes; of points, as alike as two seeds of one capture."""
    path = write_ply(tmp_path / "garden.ply", random_cloud(3_000, degree=2))
    add_camera()
    b_scene = use_stipple(method=method)
    b_scene.stipple.samples = 64
    b_linked = link(path)
    linked = render(tmp_path / "linked.exr")
    bpy.data.objects.remove(b_linked)
    bpy.ops.import_scene.splats(filepath=str(path), up_axis="Z")
    imported = render(tmp_path / "imported.exr")
    b_scene.stipple.seed = 1
    noise = rms(render(tmp_path / "seed.exr") - imported)
    assert imported[..., :3].std() > 0.05
    assert rms(linked - imported) < (0.004 if method == "SORTED" else 1.05 * noise)
    assert rms(linked - imported) > 0  # it did come from quantised data


def test_frames_and_samples_share_one_upload(path: Path, tmp_path: Path) -> None:
    add_camera()
    use_stipple()
    b_object = link(path)
    b_copy = b_object.copy()
    bpy.context.scene.collection.objects.link(b_copy)
    first, second = synced()
    assert first.cloud is second.cloud is synced()[0].cloud
    render(tmp_path / "a.png")
    (held,) = residency._renderers["cpu"]._clouds.values()
    render(tmp_path / "b.png")
    assert [again[1] for again in residency._renderers["cpu"]._clouds.values()] == [held[1]]


def test_large_captures_are_linked_without_asking(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for limit, expected in ((299, True), (300, False)):
        monkeypatch.setattr("stipple.addon.operators.import_splats.link_above", lambda limit=limit: limit)
        bpy.ops.import_scene.splats(filepath=str(path))
        assert is_linked(bpy.context.view_layer.objects.active.data) == expected


def test_the_limit_is_a_preference() -> None:
    b_addon = bpy.context.preferences.addons.new()
    try:
        b_addon.module = preferences.PACKAGE
        assert preferences.link_above() == 10_000_000
        b_addon.preferences.link_above = 5
        b_addon.preferences.cache = "OFF"
        assert preferences.link_above() == 5
        assert preferences.cache_places().of(Path("/x/garden.ply")) == ()
    finally:
        bpy.context.preferences.addons.remove(b_addon)
    assert preferences.link_above() == 10_000_000


def test_the_blend_file_holds_the_proxy_only(tmp_path: Path) -> None:
    path = write_large(tmp_path / "garden.ply", 400_000, 15)  # 94 MB
    save(tmp_path / "empty.blend")
    b_object = link(path)
    assert 95_000 <= splat_count_of(b_object.data) <= 100_000
    assert "radiance:sh_0" not in b_object.data.attributes
    save(tmp_path / "scene.blend")
    grown = (tmp_path / "scene.blend").stat().st_size - (tmp_path / "empty.blend").stat().st_size
    assert grown < 100_000 * 64 + 1e6  # of a capture of any size
    scale = np.empty(3 * splat_count_of(b_object.data), np.float32)
    b_object.data.attributes["scale"].data.foreach_get("vector", scale)
    assert np.median(scale) == pytest.approx(0.01 * 2, rel=0.05)  # every fourth splat covers what four did


def test_nodes_that_instance_a_linked_capture_place_the_file(path: Path) -> None:
    b_object = link(path)
    node_tree(b_object, "instances")
    instances = synced()
    assert len(instances) == 10
    assert {type(instance.cloud) for instance in instances} == {CaptureFile}


def test_nodes_that_change_its_points_change_nothing(path: Path) -> None:
    b_object = link(path)
    node_tree(b_object, "transform")
    (instance,) = synced()
    assert isinstance(instance.cloud, CaptureFile)


@pytest.mark.parametrize(("kind", "count"), [("realized", 3_000), ("deleted", 150)])
def test_nodes_that_make_new_points_of_it_leave_the_proxy_and_it_is_said(path: Path, kind: str, count: int) -> None:
    b_object = link(path)
    node_tree(b_object, kind)
    scene, warnings = scene_from_depsgraph(bpy.context.evaluated_depsgraph_get(), CloudCache())
    (instance,) = scene.instances
    assert isinstance(instance.cloud, SplatCloud) and instance.cloud.splat_count == count
    assert warnings == (
        f"garden: its modifiers leave {count:,} points of the proxy in place of the linked file's 300 splats; "
        "let them instance it, or import it without Link.",
    )
    assert in_viewport()[1] == warnings


def test_applying_a_transform_is_refused(path: Path) -> None:
    b_object = link(path)
    b_object.scale = (2, 2, 2)
    with pytest.raises(RuntimeError, match="its splats are in a linked file"):
        bpy.ops.object.stipple_apply_transform()
    assert tuple(b_object.scale) == (2, 2, 2)


def test_bad_files_leave_nothing(tmp_path: Path) -> None:
    bad = tmp_path / "bad.ply"
    bad.write_bytes(b"ply\nnot really\n")
    with pytest.raises(RuntimeError, match=r"bad\.ply"):
        link(bad)
    assert not bpy.data.objects and not bpy.data.cache_files and not len(bpy.data.pointclouds) + len(bpy.data.meshes)


def test_dropped_splats_are_reported(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    cloud = random_cloud()
    cloud.position[:4, 0] = np.nan
    b_object = link(write_ply(tmp_path / "garden.ply", cloud))
    printed = capfd.readouterr()
    assert "4 of 200 splats were left out" in printed.out + printed.err
    assert b_object.data.stipple_capture.splat_count == 196


def test_the_panel_is_for_linked_captures_only(path: Path) -> None:
    link(path)
    assert DATA_PT_stipple_linked_capture.poll(bpy.context)
    add_capture(random_cloud())
    bpy.context.view_layer.objects.active = bpy.data.objects["Capture"]
    assert not DATA_PT_stipple_linked_capture.poll(bpy.context)
    assert not bpy.ops.object.stipple_relink_capture.poll()
    assert linked_capture.problem_of(bpy.data.objects["garden"].data, "garden") == ""
