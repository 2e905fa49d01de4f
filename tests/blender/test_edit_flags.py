# SPDX-License-Identifier: GPL-3.0-or-later
"""Edit Splats: the mode, selection and flags, and that what goes wrong changes nothing."""

from __future__ import annotations

from pathlib import Path

import bpy
import numpy as np
import pytest

from stipple.addon import sync
from stipple.addon.edit import session as sessions
from stipple.addon.residency import CloudCache
from stipple.addon.splat_data import STATE, states_of
from stipple.engine.edit.state import DELETED, HIDDEN, LOCKED, SELECTED
from stipple.engine.scene import Instance

from .captures import add_camera, add_capture, random_cloud, render, use_stipple
from .editing import activate, cloud_of, edited, every_byte, flags, positions, refused

pytestmark = pytest.mark.blender


def select_left() -> None:
    """Half of the splats."""
    bpy.ops.stipple.select_sphere(center=(-1, 0, 0), radius=1.0)


def test_selection_lives_in_an_attribute_of_the_datablock() -> None:
    b_object = edited()
    select_left()
    inside = np.linalg.norm(positions(b_object) - (-1, 0, 0), axis=1) <= 1
    assert np.array_equal(flags(b_object, SELECTED), inside) and 20 < inside.sum() < 120
    bpy.ops.stipple.select_all(action="INVERT")
    assert np.array_equal(flags(b_object, SELECTED), ~inside)
    bpy.ops.stipple.select_all(action="DESELECT")
    assert states_of(b_object.data) is None  # an attribute of zeros is none


@pytest.mark.parametrize(("mode", "expected"), [
    ("SET", lambda a, b: b), ("ADD", lambda a, b: a | b), ("SUB", lambda a, b: a & ~b),
    ("XOR", lambda a, b: a ^ b), ("AND", lambda a, b: a & b),
])  # fmt: skip
def test_modes_combine(mode: str, expected: object) -> None:
    b_object = edited()
    select_left()
    first = flags(b_object, SELECTED)
    bpy.ops.stipple.select_opacity(low=0.5, high=0.8, mode=mode)
    opacity = random_cloud().opacity
    second = (opacity >= np.float32(0.5)) & (opacity <= np.float32(0.8))
    assert np.array_equal(flags(b_object, SELECTED), expected(first, second))


def test_hidden_and_locked_splats_are_left_alone() -> None:
    b_object = edited()
    select_left()
    left = flags(b_object, SELECTED)
    bpy.ops.stipple.hide()
    bpy.ops.stipple.select_all(action="SELECT")
    assert np.array_equal(flags(b_object, HIDDEN), left)
    bpy.ops.stipple.lock()
    bpy.ops.stipple.reveal()
    bpy.ops.stipple.delete()  # of the selected ones only the revealed are unlocked
    assert np.array_equal(flags(b_object, DELETED), left) and np.array_equal(flags(b_object, LOCKED), ~left)
    bpy.ops.stipple.restore()
    bpy.ops.stipple.unlock()
    assert not flags(b_object, DELETED | LOCKED).any()


def test_leaving_takes_deleted_splats_out_and_keeps_other_attributes() -> None:
    b_object = edited()
    before = every_byte(b_object.data)
    b_object.data.attributes.new("age", "INT", "POINT").data.foreach_set("value", np.arange(200, dtype=np.int32))
    select_left()
    left = flags(b_object, SELECTED)
    bpy.ops.stipple.delete()
    assert len(positions(b_object)) == 200
    assert bpy.ops.stipple.edit_mode_toggle() == {"FINISHED"}
    after = every_byte(b_object.data)
    assert np.array_equal(np.frombuffer(after["age"][1], np.int32), np.flatnonzero(~left))
    for name in before.keys() - {STATE}:
        whole = np.frombuffer(before[name][1], np.uint8).reshape(200, -1)
        assert after[name][1] == whole[~left].tobytes(), name
    assert STATE not in after


def test_undo_and_redo_restore_every_byte_across_the_mode() -> None:
    b_object = edited()
    name, seen = b_object.name, [every_byte(b_object.data)]
    actions = [
        select_left,
        bpy.ops.stipple.delete,
        lambda: bpy.ops.stipple.select_all(action="INVERT"),
        bpy.ops.stipple.hide,
        bpy.ops.stipple.edit_mode_toggle,
    ]
    for action in actions:
        action()
        bpy.ops.ed.undo_push(message="Step")
        seen.append(every_byte(bpy.data.objects[name].data))
    assert len({str(one) for one in seen}) == len(seen)
    for expected in reversed(seen[:-1]):
        bpy.ops.ed.undo()
        assert every_byte(bpy.data.objects[name].data) == expected
    for expected in seen[1:]:
        bpy.ops.ed.redo()
        assert every_byte(bpy.data.objects[name].data) == expected


def test_the_next_operator_sees_what_undo_and_scripts_changed() -> None:
    b_object = edited()
    bpy.ops.stipple.select_all(action="SELECT")
    moved = positions(b_object) + np.float32(10)
    b_object.data.attributes["position"].data.foreach_set("vector", moved.reshape(-1))  # and no tag
    bpy.ops.stipple.select_sphere(center=(10, 10, 10), radius=5)
    assert flags(b_object, SELECTED).all()
    bpy.ops.ed.undo_push(message="Moved")
    bpy.ops.ed.undo()
    bpy.ops.stipple.select_sphere(center=(0, 0, 0), radius=5)
    assert flags(bpy.data.objects["Capture"], SELECTED).all()


def test_edits_survive_saving(tmp_path: Path) -> None:
    b_object = edited()
    select_left()
    bpy.ops.stipple.delete()
    expected = every_byte(b_object.data)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "edited.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "edited.blend"))
    b_object = bpy.data.objects["Capture"]
    assert every_byte(b_object.data) == expected
    bpy.ops.stipple.restore()
    assert not flags(b_object, DELETED).any()


def test_final_renders_leave_deleted_splats_out_and_show_no_highlight(tmp_path: Path) -> None:
    use_stipple()
    add_camera()
    b_object = edited()
    plain = render(tmp_path / "plain.exr")
    select_left()
    bpy.ops.stipple.select_all(action="INVERT")
    bpy.ops.stipple.hide()
    bpy.ops.stipple.select_all(action="SELECT")
    assert np.array_equal(render(tmp_path / "hidden.exr"), plain)
    bpy.ops.stipple.delete()
    deleted = render(tmp_path / "deleted.exr")
    assert np.abs(deleted - plain).max() > 0.05
    bpy.ops.stipple.edit_mode_toggle()
    assert np.array_equal(render(tmp_path / "left.exr"), deleted)
    assert len(positions(b_object)) < 200


def test_viewports_show_flags_only_while_editing() -> None:
    b_object = edited()
    select_left()
    depsgraph = bpy.context.evaluated_depsgraph_get()

    def instance() -> object:
        depsgraph.update()
        from stipple.addon.edit.shown import shown_in_viewport

        b_evaluated = b_object.evaluated_get(depsgraph)
        ((shown,), notice) = shown_in_viewport(Instance(cloud_of(b_object)), b_evaluated, 0, depsgraph.scene)
        assert notice == ""
        return shown.states

    assert np.array_equal(instance().words == SELECTED, flags(b_object, SELECTED))
    bpy.context.scene.stipple_edit.show_highlight = False
    assert instance() is None
    bpy.ops.stipple.hide()
    assert (instance().words == HIDDEN).any()
    bpy.ops.stipple.edit_mode_toggle()
    assert instance() is None
    scene, _ = sync.scene_from_depsgraph(depsgraph, CloudCache())
    assert scene.instances[0].states is None


def test_bad_calls_leave_everything_and_say_why() -> None:
    b_object = edited()
    before = every_byte(b_object.data)
    for call in (bpy.ops.stipple.delete, bpy.ops.stipple.hide, bpy.ops.stipple.lock, bpy.ops.stipple.select_more):
        with refused("Capture", "nothing is selected"):
            call()
    for call, word in ((bpy.ops.stipple.restore, "deleted"), (bpy.ops.stipple.reveal, "hidden")):
        with refused("Capture", word):
            call()
    with refused("Nowhere"):
        bpy.ops.stipple.select_circle(camera="Nowhere")
    with refused("3D viewport"):
        bpy.ops.stipple.select_circle()
    assert every_byte(b_object.data) == before


def test_refusals_say_what_the_user_was_at() -> None:
    b_object = edited()
    b_object.name = "Renamed"
    for name, verb in {"translate": "move", "rotate": "rotate", "resize": "scale", "mirror": "mirror"}.items():
        with refused("Renamed", f"nothing is selected to {verb}"):
            getattr(bpy.ops.stipple, name)()
    b_object.name = "Again"  # while there is a session
    with refused("Again", "nothing is selected to delete"):
        bpy.ops.stipple.delete()
    bpy.ops.stipple.select_all(action="SELECT")
    with refused("Again", "everything is selected", "to delete"):
        bpy.ops.stipple.delete(unselected=True)
    with refused("Again", "everything is selected", "to hide"):
        bpy.ops.stipple.hide(unselected=True)


def test_without_an_edited_capture_operators_do_not_run() -> None:
    b_object = add_capture(random_cloud())
    activate(b_object)
    with refused("Edit Splats"):
        bpy.ops.stipple.select_all()
    b_cube = bpy.data.objects.new("Cube", bpy.data.meshes.new("Cube"))
    bpy.context.scene.collection.objects.link(b_cube)
    activate(b_cube)
    with refused("poll"):
        bpy.ops.stipple.edit_mode_toggle()


def test_other_objects_can_be_worked_with_meanwhile() -> None:
    b_object = edited()
    b_other = add_capture(random_cloud(seed=2), "Other")
    activate(b_other)
    with refused("Edit Splats"):
        bpy.ops.stipple.delete()
    activate(b_object)
    bpy.ops.stipple.select_all(action="SELECT")
    assert flags(b_object, SELECTED).all() and states_of(b_other.data) is None


def test_every_splat_deleted_is_no_capture_to_leave() -> None:
    b_object = edited()
    bpy.ops.stipple.select_all(action="SELECT")
    bpy.ops.stipple.delete()
    with refused("every splat is deleted"):
        bpy.ops.stipple.edit_mode_toggle()
    assert len(positions(b_object)) == 200


def test_linked_data_is_refused(tmp_path: Path) -> None:
    b_object = add_capture(random_cloud())
    bpy.data.libraries.write(str(tmp_path / "library.blend"), {b_object})
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    with bpy.data.libraries.load(str(tmp_path / "library.blend"), link=True) as (_, into):
        into.objects = ["Capture"]
    bpy.context.scene.collection.objects.link(into.objects[0])
    activate(into.objects[0])
    before = every_byte(into.objects[0].data)
    with refused("Capture", "make it local"):
        bpy.ops.stipple.edit_mode_toggle()
    assert every_byte(into.objects[0].data) == before


def test_running_out_of_memory_while_writing_leaves_the_data(monkeypatch: pytest.MonkeyPatch) -> None:
    b_object = edited()
    select_left()
    before, real = every_byte(b_object.data), sessions.write_states
    calls = []

    def fail_once(b_data: object, states: np.ndarray) -> None:
        calls.append(states)
        real(b_data, states)
        if len(calls) == 1:
            raise MemoryError

    monkeypatch.setattr(sessions, "write_states", fail_once)
    with refused("memory"):
        bpy.ops.stipple.delete()
    assert len(calls) == 2 and every_byte(b_object.data) == before
    bpy.ops.stipple.delete()
    assert flags(b_object, DELETED).any()


def test_invalid_splats_must_go_first() -> None:
    b_object = edited()
    broken = positions(b_object)
    broken[5:8] = np.nan
    b_object.data.attributes["position"].data.foreach_set("vector", broken.reshape(-1))
    with refused("3 splats", "Delete Invalid"):
        bpy.ops.stipple.select_all(action="SELECT")
    assert bpy.ops.stipple.delete_invalid() == {"FINISHED"}
    bpy.ops.stipple.select_all(action="SELECT")
    assert len(positions(b_object)) == 197 and flags(b_object, SELECTED).all()
