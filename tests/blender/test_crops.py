# SPDX-License-Identifier: GPL-3.0-or-later
"""Crops: the objects that crop, moving, deleted and disabled ones too, and the operators that add and remove them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest

from stipple.addon import sync
from stipple.addon.crop_lists import cropped_objects, evaluate_again, with_other_lists
from stipple.addon.residency import CloudCache
from stipple.engine.look import MOST_CROPS, Crop, Look
from tests.oracle.look import kept

from .captures import add_camera, add_capture, in_viewport, random_cloud, render, use_stipple
from .test_looks import add_crop, looks, read
from .test_sync import add_empty

pytestmark = pytest.mark.blender


def visible(look: Look, b_object: Any) -> np.ndarray:
    """Which splats the crops keep, by Blender's own matrices."""
    cloud = sync.scene_from_depsgraph(bpy.context.evaluated_depsgraph_get(), CloudCache())[0].instances[0].cloud
    return kept(cloud.position.astype(np.float64), np.array(b_object.matrix_world)[:3], look.crops)


def test_an_empty_crops_by_what_it_draws() -> None:
    b_object = add_capture(random_cloud())
    b_empty = add_empty("Volume", empty_display_size=0.5, scale=(1.0, 2.0, 1.0), location=(0.25, 0.0, 0.0))
    add_crop(b_object, b_empty)
    (look,) = looks()
    assert look.crops == (Crop(((0.5, 0, 0, 0.25), (0, 1, 0, 0), (0, 0, 0.5, 0)), "box", "inside"),)


@pytest.mark.parametrize(("shape", "keep"), [("BOX", "INSIDE"), ("SPHERE", "OUTSIDE")])
def test_an_object_crops_by_its_bounding_box(shape: str, keep: str) -> None:
    b_object = add_capture(random_cloud(2000))
    b_mesh = bpy.data.meshes.new("Body")
    b_mesh.from_pydata([(0, 0, 0), (1, 0, 0), (0, 0.5, 0), (0, 0, 0.4)], [], [(0, 1, 2), (0, 2, 3)])
    b_body = bpy.data.objects.new("Body", b_mesh)
    bpy.context.scene.collection.objects.link(b_body)
    b_body.location, b_body.rotation_euler = (-0.3, 0.1, 0.0), (0.2, 0.4, 0.6)
    b_object.rotation_euler = (1.0, 0.0, 0.3)
    add_crop(b_object, b_body, shape, keep)
    (look,) = looks()
    mask = visible(look, b_object)
    world = np.array(b_object.matrix_world) @ np.column_stack([read()[0].instances[0].cloud.position, np.ones(2000)]).T
    local = (np.linalg.inv(np.array(b_body.matrix_world)) @ world)[:3].T / (1, 0.5, 0.4) * 2 - 1
    within = np.abs(local).max(axis=1) <= 1 if shape == "BOX" else np.linalg.norm(local, axis=1) <= 1
    assert 5 < within.sum() < 1995
    np.testing.assert_array_equal(mask, within if keep == "INSIDE" else ~within)


def test_a_moving_crop_object_reveals_a_capture(tmp_path: Path) -> None:
    """Its location is driven, the capture stands still; rendered frame by frame."""
    b_scene = use_stipple()
    b_scene.render.film_transparent = True
    b_object = add_capture(random_cloud(800))
    add_camera()
    b_empty = add_empty("Volume", scale=(1.0, 2.0, 2.0))
    b_empty.driver_add("location", 0).driver.expression = "(frame - 11) / 5"  # -2 at frame 1: all of it is outside
    add_crop(b_object, b_empty)
    covered = []
    for frame in (1, 6, 11):
        b_scene.frame_set(frame)
        alpha = render(tmp_path / f"{frame}.exr")[..., 3]
        covered.append((alpha > 0.5).mean(axis=0))
    assert covered[0].max() < 0.1  # only a splat's rim on the left
    assert covered[1][:32].max() > 0.2 and covered[1][36:].max() == 0.0
    assert covered[2][:32].max() > 0.2 and covered[2][36:].max() > 0.2
    b_object.stipple.crops[0].use = False
    assert (render(tmp_path / "whole.exr")[..., 3] > 0.5).mean() >= covered[2].mean()


def test_a_deleted_crop_object_is_ignored_with_a_notice() -> None:
    b_object, b_empty = add_capture(random_cloud()), add_empty("Volume", scale=(0.1, 0.1, 0.1))
    add_crop(b_object, b_empty)
    assert len(looks()[0].crops) == 1
    with bpy.context.temp_override(selected_objects=[b_empty]):
        bpy.ops.object.delete()  # the crop keeps the datablock, which is in no collection any more
    scene, warnings = read()
    assert scene.instances[0].look.crops == ()
    assert warnings == ("Capture: crop 1 has no object any more and is ignored.",)
    bpy.data.objects.remove(b_object.stipple.crops[0].object)
    assert read()[1] == warnings
    b_object.stipple.crops[0].use = False
    assert read()[1] == ()


def test_crop_objects_that_blender_does_not_evaluate_are_named() -> None:
    b_object, b_empty = add_capture(random_cloud()), add_empty("Volume", scale=(0.5, 0.5, 0.5))
    add_crop(b_object, b_empty)
    b_empty.hide_viewport = True
    assert read()[1] == ()  # stands still anyway
    b_empty.keyframe_insert("location", frame=1)
    (warning,) = read()[1]
    assert "Capture: the crop object Volume is disabled here and does not move" in warning
    b_empty.hide_viewport = False
    b_empty.hide_set(True)
    assert read()[1] == ()  # the eye icon hides it and Blender goes on moving it


@pytest.mark.parametrize("hide", ["disabled", "excluded"])
def test_a_disabled_crop_object_stands_where_it_stood_when_the_file_is_opened_again(tmp_path: Path, hide: str) -> None:
    b_object, b_empty = add_capture(random_cloud()), add_empty("Volume", scale=(0.5, 1.0, 1.0), location=(0.2, 0, 0))
    b_empty.parent = b_object
    b_empty.matrix_parent_inverse.translation = (0.0, 0.3, 0.0)
    b_object.location = (0.0, 0.0, 3.0)
    add_crop(b_object, b_empty)
    (look,) = looks()
    assert look.crops[0].world_from_crop == (
        (0.5, 0, 0, pytest.approx(0.2)),
        (0, 1, 0, pytest.approx(0.3)),
        (0, 0, 1, 3),
    )
    if hide == "disabled":
        b_empty.hide_viewport = b_empty.hide_render = True
    else:
        exclude(b_empty)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "shot.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "shot.blend"))
    scene, warnings = read()
    np.testing.assert_allclose(
        scene.instances[0].look.crops[0].world_from_crop, look.crops[0].world_from_crop, atol=1e-6
    )
    assert warnings == ()


def exclude(*b_objects: Any) -> Any:
    """A new collection, excluded from the view layer, and the objects in nothing else."""
    b_collection = bpy.data.collections.new("Set")
    bpy.context.scene.collection.children.link(b_collection)
    for b_object in b_objects:
        bpy.context.scene.collection.objects.unlink(b_object)
        b_collection.objects.link(b_object)
    bpy.context.view_layer.layer_collection.children["Set"].exclude = True
    return b_collection


def test_a_crop_object_that_is_instanced_from_an_excluded_collection_moves() -> None:
    b_object, b_empty = add_capture(random_cloud()), add_empty("Volume", scale=(0.5, 1.0, 1.0))
    add_crop(b_object, b_empty)
    for frame in (1, 2):
        b_empty.location.x = frame
        b_empty.keyframe_insert("location", frame=frame)
    b_collection = exclude(b_object, b_empty)
    add_empty("Instance", instance_type="COLLECTION", instance_collection=b_collection, location=(0.0, 5.0, 0.0))
    for frame in (1, 2):
        bpy.context.scene.frame_set(frame)
        scene, warnings = read()
        np.testing.assert_allclose(np.array(scene.instances[0].look.crops[0].world_from_crop)[:, 3], (frame, 5, 0))
        assert warnings == ()


@pytest.mark.parametrize("moves", [False, True])
@pytest.mark.parametrize("kind", ["Object", "Collection"])
def test_a_capture_that_is_linked_without_its_crop_object_is_cropped(tmp_path: Path, kind: str, moves: bool) -> None:
    """Of the crop object Blender reads the datablock and evaluates nothing."""
    b_object, b_empty = add_capture(random_cloud()), add_empty("Volume", scale=(0.5, 1.0, 1.0), location=(0.2, 0, 0))
    b_empty.parent = b_object
    b_object.location = (0.0, 0.0, 3.0)
    add_crop(b_object, b_empty)
    if moves:
        b_empty.keyframe_insert("location", frame=1)
    b_collection = bpy.data.collections.new("Statue")
    b_collection.objects.link(b_object)
    bpy.data.libraries.write(str(tmp_path / "library.blend"), {b_collection})
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    name = {"Object": "Capture", "Collection": "Statue"}[kind]
    folder = f"{tmp_path / 'library.blend'}/{kind}/"
    bpy.ops.wm.link(filepath=folder + name, directory=folder, filename=name)
    scene, warnings = read()
    matrix = np.array(scene.instances[0].look.crops[0].world_from_crop)
    np.testing.assert_allclose(matrix, ((0.5, 0, 0, 0.2), (0, 1, 0, 0), (0, 0, 1, 3)), atol=1e-6)
    text = "Capture: the crop object Volume is in no collection here and does not move; link its collection, too."
    assert warnings == ((text,) if moves else ())


def test_crops_that_python_takes_from_the_list_are_noticed() -> None:
    """Blender tells nobody, so that viewports would go on showing them."""
    b_object = add_capture(random_cloud())
    add_capture(random_cloud(), "Other")
    for name in ("First", "Second"):
        add_crop(b_object, add_empty(name))

    def names_and_crops() -> tuple[frozenset[str], int]:
        bpy.context.view_layer.update()
        instances, _ = in_viewport()
        return cropped_objects(instances), sum(len(instance.look.crops) for instance in instances)

    def changed(names: frozenset[str]) -> list[str]:
        return with_other_lists(names, bpy.context.evaluated_depsgraph_get())

    crops = b_object.stipple.crops
    for change, before in ((lambda: crops.remove(0), 2), (crops.clear, 1)):
        names, count = names_and_crops()
        assert names == {"Capture"} and count == before and changed(names) == []
        change()
        assert names_and_crops()[1] == before  # as long as nobody says so
        assert changed(names) == ["Capture"]
        evaluate_again(changed(names))
        assert names_and_crops()[1] == before - 1 and changed(names) == []


def test_more_crops_than_the_engine_has_are_left_out_with_a_notice() -> None:
    b_object, b_empty = add_capture(random_cloud()), add_empty("Volume")
    for _ in range(MOST_CROPS + 1):
        add_crop(b_object, b_empty)
    scene, (warning,) = read()
    assert len(scene.instances[0].look.crops) == MOST_CROPS
    assert f"{MOST_CROPS + 1} crops are in use, the first {MOST_CROPS} of them crop" in warning


def activate(b_object: Any, *b_others: Any) -> Any:
    return bpy.context.temp_override(
        object=b_object, active_object=b_object, selected_objects=[b_object, *b_others], mode="OBJECT"
    )


def test_a_new_crop_begins_around_the_capture_and_moves_with_it() -> None:
    b_object = add_capture(random_cloud(), "Statue")
    b_object.location, b_object.rotation_euler = (1.0, 2.0, 3.0), (0.3, 0.0, 0.7)
    bpy.context.view_layer.update()
    with activate(b_object):
        assert bpy.ops.object.stipple_crop_add(shape="BOX") == {"FINISHED"}
    bpy.context.view_layer.update()
    b_empty = b_object.stipple.crops[0].object
    assert (b_empty.name, b_empty.parent, b_empty.empty_display_type) == ("Statue Crop", b_object, "CUBE")
    assert visible(looks()[0], b_object).all()
    b_object.location = (-4.0, 0.0, 0.0)
    bpy.context.view_layer.update()
    assert visible(looks()[0], b_object).all()
    with activate(b_object):
        bpy.ops.object.stipple_crop_add(shape="SPHERE", keep="OUTSIDE", parent=False)
    bpy.context.view_layer.update()
    assert 0 < visible(looks()[0], b_object).sum() < 200
    assert b_object.stipple.active_crop == 1
    with activate(b_object):
        bpy.ops.object.stipple_crop_remove()
        bpy.ops.object.stipple_crop_remove(index=0)
    assert looks()[0].crops == () and "Statue Crop" in bpy.data.objects
    with activate(b_object), pytest.raises(RuntimeError):
        bpy.ops.object.stipple_crop_remove()


def test_selected_objects_become_crops() -> None:
    b_object, b_one, b_two = add_capture(random_cloud()), add_empty("One"), add_empty("Two")
    with activate(b_object, b_one, b_two):
        bpy.ops.object.stipple_crop_add(use_selected=True, shape="SPHERE", keep="OUTSIDE")
    assert [(c.object, c.shape, c.keep) for c in b_object.stipple.crops] == [
        (b_one, "SPHERE", "OUTSIDE"),
        (b_two, "SPHERE", "OUTSIDE"),
    ]
    with activate(b_object), pytest.raises(RuntimeError, match="select the objects to crop by too"):
        bpy.ops.object.stipple_crop_add(use_selected=True)
    for _ in range(MOST_CROPS - 2):
        with activate(b_object):
            bpy.ops.object.stipple_crop_add()
    with activate(b_object), pytest.raises(RuntimeError, match="at most 8 crops"):
        bpy.ops.object.stipple_crop_add()


def test_a_flat_crop_object_is_named() -> None:
    """A plane has nothing inside: the capture is gone, and the artist is told why."""
    b_object, b_mesh = add_capture(random_cloud()), bpy.data.meshes.new("Plane")
    b_mesh.from_pydata([(-1, -1, 0), (1, -1, 0), (1, 1, 0)], [], [(0, 1, 2)])
    b_plane = bpy.data.objects.new("Plane", b_mesh)
    bpy.context.scene.collection.objects.link(b_plane)
    add_crop(b_object, b_plane)
    assert read()[1] == ("Capture: the crop object Plane is flat and holds nothing; give it a thickness.",)
