# SPDX-License-Identifier: GPL-3.0-or-later
"""Edit Splats: transforms, copies, objects of their own, clean-up and export."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest
from mathutils import Euler, Matrix

from stipple.addon import splat_data
from stipple.addon.edit.drag import number_of
from stipple.addon.edit.ui import counts
from stipple.engine.edit.state import DELETED, SELECTED
from stipple.engine.edit.transform import transform_cloud

from .captures import add_camera, add_capture, assert_same_cloud, random_cloud, render, use_stipple
from .editing import activate, assert_close, cloud_of, edited, every_byte, flags, part, positions, refused

pytestmark = pytest.mark.blender
PLACED = Matrix.LocRotScale((1, 2, -3), Euler((0.3, -0.5, 1.1)), (1.5, 1.5, 1.5))


@pytest.mark.parametrize(("call", "expected"), [
    (lambda: bpy.ops.stipple.translate(value=(1, -2, 0.5)), Matrix.Translation((1, -2, 0.5))),
    (lambda: bpy.ops.stipple.rotate(value=0.7, axis=(0, 0, 2), pivot="ORIGIN"), Matrix.Rotation(0.7, 4, "Z")),
    (lambda: bpy.ops.stipple.resize(value=(2, 2, 2), pivot="ORIGIN"), Matrix.Scale(2, 4)),
    (lambda: bpy.ops.stipple.mirror(axis="Y", pivot="ORIGIN"), Matrix.Scale(-1, 4, (0, 1, 0))),
])  # fmt: skip
def test_the_selection_is_transformed_in_the_world(call: Any, expected: Matrix) -> None:
    b_object = edited()
    b_object.location = (0.0, 0.0, 0.0)
    before = cloud_of(b_object)
    bpy.ops.stipple.select_sphere(center=(-1, 0, 0), radius=1.0)
    chosen = flags(b_object, SELECTED)
    call()
    after = cloud_of(b_object)
    assert_same_cloud(part(after, ~chosen), part(before, ~chosen))
    assert_close(part(after, chosen), transform_cloud(part(before, chosen), np.array(expected)[:3]))


def test_a_turned_object_moves_along_the_worlds_axes() -> None:
    b_object = edited()
    b_object.matrix_world = PLACED
    bpy.context.view_layer.update()
    before = positions(b_object)
    bpy.ops.stipple.select_all(action="SELECT")
    bpy.ops.stipple.translate(value=(0, 0, 2))
    way = (positions(b_object) - before) @ np.array(PLACED)[:3, :3].T
    assert np.allclose(way, (0, 0, 2), atol=1e-5)


def test_a_flattening_scale_is_refused() -> None:
    b_object = edited()
    bpy.ops.stipple.select_all(action="SELECT")
    before = every_byte(b_object.data)
    with refused("flattens"):
        bpy.ops.stipple.resize(value=(1, 0, 1))
    assert every_byte(b_object.data) == before


def test_copies_are_selected_and_take_other_attributes_along() -> None:
    b_object = edited()
    b_object.data.attributes.new("age", "INT", "POINT").data.foreach_set("value", np.arange(200, dtype=np.int32))
    bpy.ops.stipple.select_sphere(center=(-1, 0, 0), radius=1.0)
    chosen, before = flags(b_object, SELECTED), cloud_of(b_object)
    bpy.ops.ed.undo_push(message="Select")
    seen = every_byte(b_object.data)
    bpy.ops.stipple.duplicate()
    bpy.ops.stipple.translate(value=(5, 0, 0))
    after, count = cloud_of(b_object), int(chosen.sum())
    assert after.splat_count == 200 + count
    assert_same_cloud(part(after, np.arange(200)), before)
    moved = part(before, chosen).position + np.float32([5, 0, 0])
    assert np.allclose(after.position[200:], moved, atol=1e-6)
    assert np.array_equal(np.flatnonzero(flags(b_object, SELECTED)), 200 + np.arange(count))
    age = np.frombuffer(every_byte(b_object.data)["age"][1], np.int32)
    assert np.array_equal(age[200:], np.flatnonzero(chosen))
    bpy.ops.ed.undo_push(message="Duplicate")
    bpy.ops.ed.undo()
    assert every_byte(bpy.data.objects["Capture"].data) == seen


def test_separate_and_join_bring_everything_back() -> None:
    b_object = edited()
    b_object.matrix_world = PLACED
    bpy.context.view_layer.update()
    before = cloud_of(b_object)
    bpy.ops.stipple.select_opacity(low=0.5, high=1.0)
    chosen = flags(b_object, SELECTED)
    bpy.ops.stipple.separate()
    (b_new,) = set(bpy.context.scene.objects) - {b_object}
    assert b_new.matrix_world == b_object.matrix_world and not b_new.stipple_editing
    assert_same_cloud(cloud_of(b_new), part(before, chosen))
    assert np.array_equal(flags(b_object, DELETED), chosen)
    with refused("no splats are deleted"):
        bpy.ops.stipple.restore()
    assert bpy.ops.stipple.edit_mode_toggle() == {"FINISHED"}
    assert_same_cloud(cloud_of(b_object), part(before, ~chosen))
    b_new.select_set(True)
    b_object.select_set(True)
    bpy.ops.stipple.join()
    order = np.concatenate([np.flatnonzero(~chosen), np.flatnonzero(chosen)])
    assert_same_cloud(cloud_of(b_object), part(before, order))
    assert [b_one.name for b_one in bpy.context.scene.objects] == ["Capture"]


def test_separated_splats_are_not_restored_and_some_stay() -> None:
    """Else there would be two of each, or a capture of none."""
    b_object = edited()
    bpy.ops.stipple.select_all(action="SELECT")
    with refused("Capture", "every splat is selected"):
        bpy.ops.stipple.separate()
    bpy.ops.stipple.select_sphere(center=(-1, 0, 0), radius=1.0)
    separated = flags(b_object, SELECTED)
    seen = every_byte(b_object.data)
    bpy.ops.ed.undo_push(message="Select")
    bpy.ops.stipple.separate()
    bpy.ops.stipple.select_sphere(center=(1, 0, 0), radius=0.5)
    bpy.ops.stipple.delete()
    assert counts(b_object.data)["Deleted"] == flags(b_object, DELETED).sum() - separated.sum() > 0
    bpy.ops.stipple.restore()
    assert np.array_equal(flags(b_object, DELETED), separated) and "Deleted" not in counts(b_object.data)
    bpy.ops.ed.undo_push(message="Separate")
    bpy.ops.ed.undo()
    assert every_byte(bpy.data.objects["Capture"].data) == seen and len(bpy.data.objects) == 1


def add_ages(b_object: Any, first: int) -> None:
    """A user's own attribute, `first` and up."""
    ages = np.arange(first, first + len(b_object.data.attributes["position"].data), dtype=np.int32)
    b_object.data.attributes.new("age", "INT", "POINT").data.foreach_set("value", ages)


def ages_of(b_object: Any) -> np.ndarray:
    return np.frombuffer(every_byte(b_object.data)["age"][1], np.int32)


def test_separate_and_join_take_other_attributes_along() -> None:
    b_object = edited()
    add_ages(b_object, 1)
    bpy.ops.stipple.select_sphere(center=(-1, 0, 0), radius=1.0)
    chosen = flags(b_object, SELECTED)
    bpy.ops.stipple.separate()
    (b_new,) = set(bpy.context.scene.objects) - {b_object}
    assert np.array_equal(ages_of(b_new), 1 + np.flatnonzero(chosen))
    b_plain = add_capture(random_cloud(20), "Plain")
    activate(b_plain)
    b_new.select_set(True)
    assert bpy.ops.stipple.join() == {"FINISHED"}
    assert np.array_equal(ages_of(b_plain), [0] * 20 + list(1 + np.flatnonzero(chosen)))
    b_third = add_capture(random_cloud(10), "Third")
    add_ages(b_third, 500)
    b_third.select_set(True)
    assert bpy.ops.stipple.join() == {"FINISHED"}
    assert np.array_equal(ages_of(b_plain)[-10:], np.arange(500, 510)) and ages_of(b_plain)[:20].max() == 0


def test_what_cannot_be_carried_is_not_joined() -> None:
    """Values of two types have no common one, and texts cannot be moved."""
    b_one, b_two = add_capture(random_cloud(20), "One"), add_capture(random_cloud(10), "Two")
    b_two.data.attributes.new("age", "FLOAT", "POINT")
    add_ages(b_one, 0)
    activate(b_one)
    b_two.select_set(True)
    before = every_byte(b_one.data)
    with refused("Two", "'age' is FLOAT, and INT in One"):
        bpy.ops.stipple.join()
    b_two.data.attributes.remove(b_two.data.attributes["age"])
    b_two.data.attributes.new("note", "STRING", "POINT")
    with refused("Two", "'note' is STRING"):
        bpy.ops.stipple.join()
    assert every_byte(b_one.data) == before and "Two" in bpy.data.objects


def test_join_fits_degrees_and_places(tmp_path: Path) -> None:
    """The picture is the same before and after, to the rounding of float32."""
    use_stipple(48, 36)
    add_camera()
    b_low, b_high = add_capture(random_cloud(degree=1), "Low"), add_capture(random_cloud(degree=3, seed=2), "High")
    b_high.matrix_world = Matrix.LocRotScale((0.3, 0.2, 0.1), Euler((0.4, 0.2, 0.9)), (0.8, 0.8, 0.8))
    b_low.matrix_world = Matrix.LocRotScale((0, 0, 0.2), Euler((0.1, 0.7, 0)), (1.2, 1.2, 1.2))
    before = render(tmp_path / "two.exr")
    activate(b_high)
    b_low.select_set(True)
    assert bpy.ops.stipple.join() == {"FINISHED"}
    assert cloud_of(b_high).sh_degree == 3 and cloud_of(b_high).splat_count == 400
    assert np.abs(render(tmp_path / "one.exr") - before).max() < 2e-3


def test_what_is_no_capture_is_not_joined() -> None:
    b_object = add_capture(random_cloud())
    b_cube = bpy.data.objects.new("Cube", bpy.data.meshes.new("Cube"))
    bpy.context.scene.collection.objects.link(b_cube)
    activate(b_object)
    b_cube.select_set(True)
    before = every_byte(b_object.data)
    with refused("Cube", "no capture"):
        bpy.ops.stipple.join()
    assert every_byte(b_object.data) == before and "Cube" in bpy.data.objects


def test_clean_up_counts_selects_and_deletes() -> None:
    b_object = edited()
    before = cloud_of(b_object)
    bpy.ops.stipple.clean_faint(opacity=0.5)
    assert np.array_equal(flags(b_object, SELECTED), before.opacity <= np.float32(0.5))
    bpy.ops.stipple.clean_oversized(size=0.06, action="DELETE")
    assert np.array_equal(flags(b_object, DELETED), before.scale.max(axis=1) >= np.float32(0.06))
    b_box = bpy.data.objects.new("Box", None)
    b_box.scale = (0.5, 0.5, 0.5)
    bpy.context.scene.collection.objects.link(b_box)
    bpy.context.view_layer.update()
    bpy.ops.stipple.restore()
    bpy.ops.stipple.clean_outside(object="Box")
    assert np.array_equal(flags(b_object, SELECTED), np.abs(before.position).max(axis=1) > 0.5)
    lonely = positions(b_object)
    lonely[7] = (50, 0, 0)
    b_object.data.attributes["position"].data.foreach_set("vector", lonely.reshape(-1))
    bpy.ops.stipple.clean_floaters(factor=8.0)
    assert np.array_equal(np.flatnonzero(flags(b_object, SELECTED)), [7])


@pytest.mark.parametrize("link", [False, True])
def test_a_capture_in_an_asset_library_is_appended_or_linked(tmp_path: Path, link: bool) -> None:
    b_object = add_capture(random_cloud())
    expected = every_byte(b_object.data)
    b_object.asset_mark()
    bpy.data.libraries.write(str(tmp_path / "library.blend"), {b_object})
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    with bpy.data.libraries.load(str(tmp_path / "library.blend"), link=link, assets_only=True) as (found, into):
        assert found.objects == ["Capture"]
        into.objects = found.objects
    b_object = into.objects[0]
    bpy.context.scene.collection.objects.link(b_object)
    activate(b_object)
    assert every_byte(b_object.data) == expected
    if link:
        with refused("make it local"):
            bpy.ops.stipple.edit_mode_toggle()
    else:
        bpy.ops.stipple.edit_mode_toggle()
        bpy.ops.stipple.select_all(action="SELECT")
        assert flags(b_object, SELECTED).all()


def test_typed_numbers() -> None:
    assert [number_of(typed) for typed in ("", "-", "-1.5", ".5", "1..2")] == [None, None, -1.5, 0.5, None]
    assert math.isclose(number_of("90"), 90)


@pytest.mark.parametrize(
    ("call", "attribute"),
    [
        ("translate", "position"),
        *((c, a) for c in ("duplicate", "join") for a in ("scale", "radiance:base", "radiance:sh_3")),
    ],
)
def test_out_of_memory_in_the_middle_of_writing(call: str, attribute: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Whatever was written is taken back, the number of points too, and the next edit works."""
    b_object = edited()
    b_other = add_capture(random_cloud(seed=5, degree=3), "Other")
    add_ages(b_other, 0)
    bpy.ops.stipple.select_sphere(center=(-1, 0, 0), radius=1.0)
    before, real, failed = every_byte(b_object.data), splat_data.write_attribute, []

    def fail_once(b_data: Any, name: str, data_type: str, values: np.ndarray) -> None:
        if name == attribute and not failed:
            failed.append(name)
            raise MemoryError
        real(b_data, name, data_type, values)

    monkeypatch.setattr(splat_data, "write_attribute", fail_once)
    b_other.select_set(True)
    options = {"translate": {"value": (1, 0, 0)}}.get(call, {})
    with refused("memory"):
        getattr(bpy.ops.stipple, call)(**options)
    assert failed and every_byte(b_object.data) == before and "Other" in bpy.data.objects
    assert getattr(bpy.ops.stipple, call)(**options) == {"FINISHED"}
    assert every_byte(b_object.data) != before
