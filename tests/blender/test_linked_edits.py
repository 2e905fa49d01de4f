# SPDX-License-Identifier: GPL-3.0-or-later
"""Edits of a linked capture: the operators, Blender's undo, and what is rendered."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest

from stipple.addon import linked_edits, residency, sync
from stipple.addon.edit import preview as previews
from stipple.addon.edit.operator import session_in
from stipple.addon.edit.ui import counts
from stipple.addon.splat_data import states_of
from stipple.engine.capture_file import CaptureFile
from stipple.engine.edit.state import DELETED, HIDDEN, LOCKED, SELECTED

from .captures import add_camera, random_cloud, render, use_stipple, write_ply
from .editing import activate, every_byte
from .linked import synced
from .linked_editing import COUNT, LEFT, edit_everything, edited_link, left_of, states

pytestmark = pytest.mark.blender


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return write_ply(tmp_path / "garden.ply", random_cloud(COUNT, degree=2))


@pytest.fixture
def b_object(path: Path) -> Any:
    """An edited linked capture; its proxy has as many points, and they play no part."""
    return edited_link(path)


def test_flags_are_kept_without_a_word_in_the_datablocks_attributes(b_object: Any, path: Path) -> None:
    before, left = every_byte(b_object.data), left_of(path)
    before.pop("radius", None)  # which Solid shading goes by
    bpy.ops.stipple.select_sphere(**LEFT)
    assert np.array_equal(states(b_object) != 0, left)
    assert counts(b_object.data) == {"Splats": COUNT, "Selected": left.sum()}
    bpy.ops.stipple.delete()
    assert np.array_equal(states(b_object) == (SELECTED | DELETED), left)
    assert counts(b_object.data) == {"Splats": COUNT - left.sum(), "Selected": 0, "Deleted": left.sum()}
    bpy.ops.stipple.restore()
    bpy.ops.stipple.hide()
    assert np.array_equal(states(b_object) == (SELECTED | HIDDEN), left)
    bpy.ops.stipple.reveal()
    bpy.ops.stipple.lock(unselected=True)
    assert np.array_equal(states(b_object) == LOCKED, ~left)
    bpy.ops.stipple.unlock()
    bpy.ops.stipple.delete(unselected=True)
    assert np.array_equal(states(b_object) == DELETED, ~left)
    assert before.items() <= every_byte(b_object.data).items() and states_of(b_object.data) is None


SELECTIONS = {
    "box": lambda: bpy.ops.stipple.select_box(camera="Camera", xmin=0, xmax=32, ymin=0, ymax=48),
    "visible box": lambda: bpy.ops.stipple.select_box(
        camera="Camera", xmin=0, xmax=64, ymin=0, ymax=48, visible_only=True
    ),
    "depth": lambda: bpy.ops.stipple.select_depth(camera="Camera", near=3.0, far=3.7),
    "sphere": lambda: bpy.ops.stipple.select_sphere(**LEFT),
    "color": lambda: bpy.ops.stipple.select_color(color=(0.8, 0.5, 0.4), threshold=0.2),
    "opacity": lambda: bpy.ops.stipple.select_opacity(low=0.0, high=0.5),
    "size": lambda: bpy.ops.stipple.select_size(low=0.08),
    "floaters": lambda: bpy.ops.stipple.clean_floaters(factor=1.0),
    "faint": lambda: bpy.ops.stipple.clean_faint(opacity=0.4),
    "more": lambda: (bpy.ops.stipple.select_sphere(center=(0, 0, 0), radius=0.3), bpy.ops.stipple.select_more()),
}


@pytest.mark.parametrize("selection", SELECTIONS)
def test_every_selection_finds_what_it_finds_in_the_imported_capture(b_object: Any, path: Path, selection: str) -> None:
    """But for splats at the very edge, and of a look at what is seen, those that chance decides."""
    add_camera()
    use_stipple()
    assert SELECTIONS[selection]()
    found = (states(b_object) & SELECTED) != 0
    bpy.data.objects.remove(b_object)
    bpy.ops.import_scene.splats(filepath=str(path), up_axis="Z")
    activate(bpy.context.view_layer.objects.active)
    bpy.ops.stipple.edit_mode_toggle()
    SELECTIONS[selection]()
    expected = (states_of(bpy.context.object.data) & SELECTED) != 0
    assert 20 < expected.sum() < COUNT - 20
    assert (found != expected).mean() < (0.2 if selection == "visible box" else 0.004)


@pytest.mark.parametrize("method", ["SORTED", "RAYS"])
def test_the_picture_is_that_of_the_same_edits_of_an_imported_capture(
    b_object: Any, path: Path, tmp_path: Path, method: str
) -> None:
    add_camera()
    use_stipple(method=method)
    untouched = render(tmp_path / "untouched.exr")
    edit_everything()
    found = render(tmp_path / "linked.exr")
    assert np.abs(found - untouched).max() > 0.2
    bpy.data.objects.remove(b_object)
    bpy.ops.import_scene.splats(filepath=str(path), up_axis="Z")
    activate(bpy.context.view_layer.objects.active)
    bpy.ops.stipple.edit_mode_toggle()
    edit_everything()
    expected = render(tmp_path / "imported.exr")
    assert np.sqrt(np.mean(np.square(found - expected))) < 0.004  # what quantisation takes


def test_undo_and_redo_through_blender_mix_with_other_edits(b_object: Any, tmp_path: Path) -> None:
    add_camera()
    use_stipple()
    bpy.ops.ed.undo_push(message="Camera")
    pictures, tokens = [], []

    def look() -> None:
        b_now = bpy.data.objects["garden"]
        tokens.append(b_now.data.stipple_capture.edits)
        pictures.append((render(tmp_path / "now.exr"), b_now.location.x))

    look()
    bpy.ops.stipple.select_sphere(**LEFT)
    bpy.ops.ed.undo_push(message="Select")
    bpy.ops.stipple.delete()
    bpy.ops.ed.undo_push(message="Delete")
    look()
    bpy.data.objects["garden"].location.x = 0.5
    bpy.ops.ed.undo_push(message="Move Object")
    look()
    bpy.ops.stipple.select_sphere(center=(1, 0, 0), radius=1)
    bpy.ops.ed.undo_push(message="Select")
    bpy.ops.stipple.translate(value=(0, 0, 0.5))
    bpy.ops.ed.undo_push(message="Move")
    look()
    assert len(set(tokens)) == 3
    done, pictures = pictures, []
    for _ in range(2):
        bpy.ops.ed.undo()
    look()
    bpy.ops.ed.undo()
    look()
    for _ in range(2):
        bpy.ops.ed.undo()
    look()
    for _ in range(5):
        bpy.ops.ed.redo()
    look()
    for (found, x), (expected, expected_x) in zip(pictures, [done[2], done[1], done[0], done[3]], strict=True):
        assert x == expected_x and np.array_equal(found, expected)
    assert session_in(bpy.context).cloud.edits.token == tokens[3]


def test_viewports_show_what_is_hidden_and_selected_only_while_editing(b_object: Any) -> None:
    depsgraph = bpy.context.evaluated_depsgraph_get()

    def words() -> list[int]:
        """All flags that an instance has."""
        depsgraph.update()
        b_evaluated = bpy.data.objects["garden"].evaluated_get(depsgraph)
        from stipple.addon.edit.shown import shown_in_viewport
        from stipple.engine.scene import Instance

        capture = residency.linked.capture_of(b_evaluated.data, "garden")
        shown, _ = shown_in_viewport(Instance(capture), b_evaluated, 0, depsgraph.scene)
        return [int(np.bitwise_or.reduce(i.states.words)) if i.states else 0 for i in shown]

    bpy.ops.stipple.select_sphere(**LEFT)
    assert words() == [SELECTED]
    bpy.ops.stipple.translate(value=(0, 0, 1))
    assert words() == [HIDDEN, SELECTED]  # moved splats are drawn by the second instance
    bpy.ops.stipple.hide()
    assert words() == [HIDDEN, HIDDEN | SELECTED]
    bpy.ops.stipple.edit_mode_toggle()
    assert words() == [HIDDEN, 0]
    assert [instance.states is None for instance in synced()] == [False, True]


def test_a_drag_shows_before_it_is_written(b_object: Any) -> None:
    from stipple.engine.edit.affine import translation
    from stipple.engine.edit.transform import TransformDrag

    bpy.ops.stipple.select_sphere(**LEFT)
    token, session = b_object.data.stipple_capture.edits, session_in(bpy.context)
    b_evaluated = b_object.evaluated_get(bpy.context.evaluated_depsgraph_get())
    drag, shown = TransformDrag(session.cloud), []
    for step in (1, 2):
        drag.update(translation((step, 0, 0)))
        previews.show_preview(b_object.data, session, translation((step, 0, 0)), np.eye(3, 4))
        edits = previews.preview_of(b_evaluated).edited.edits
        assert np.array_equal(edits.matrices, [translation((step, 0, 0))])
        shown.append(previews.shown_previews())
    assert shown[0] != shown[1]
    step = drag.finish()
    previews.end_preview(b_object.data)
    assert b_object.data.stipple_capture.edits == token
    assert session.commit(b_object.data, step, done=True)
    assert np.array_equal(session.cloud.edits.matrices, [translation((2, 0, 0))])


def test_a_stroke_shows_before_it_is_written_and_leaves_nothing_when_cancelled(b_object: Any) -> None:
    from stipple.engine.edit.brush import Brush
    from stipple.engine.edit.paint_stroke import PaintStroke

    session = session_in(bpy.context)
    stroke = PaintStroke(session.cloud, Brush(colour=(1, 0, 0)))
    stroke.dab((0, 0, 0), 0.8)
    previews.show_preview(b_object.data, session)
    b_evaluated = b_object.evaluated_get(bpy.context.evaluated_depsgraph_get())
    assert previews.preview_of(b_evaluated).edited.rows.splat_count > 100
    stroke.cancel()
    previews.show_preview(b_object.data, session)
    assert previews.preview_of(b_evaluated).edited.rows is None
    previews.end_preview(b_object.data)
    assert b_object.data.stipple_capture.edits == ""


def test_discarded_edits_come_back_with_undo(b_object: Any) -> None:
    bpy.ops.stipple.select_sphere(**LEFT)
    bpy.ops.stipple.delete()
    bpy.ops.ed.undo_push(message="Delete")
    assert len([instance for instance in synced() if instance.states is not None]) == 1
    assert bpy.ops.stipple.discard_edits() == {"FINISHED"}
    bpy.ops.ed.undo_push(message="Discard")
    (instance,) = synced()
    assert isinstance(instance.cloud, CaptureFile) and instance.states is None
    assert not bpy.ops.stipple.discard_edits.poll()
    bpy.ops.ed.undo()
    assert synced()[0].states is not None


def test_no_more_states_are_kept_than_undo_can_ask_for(b_object: Any) -> None:
    bpy.context.preferences.edit.undo_steps = 10
    try:
        for index in range(100):
            bpy.ops.stipple.select_sphere(center=(-1, 0, 0), radius=0.5 + 0.01 * index)
        assert len(linked_edits._kept) == linked_edits.FEWEST_KEPT
        assert states(b_object).any()
    finally:
        bpy.context.preferences.edit.undo_steps = 32


def test_a_slider_of_the_redo_panel_takes_no_undo_step_away(b_object: Any) -> None:
    """With every value it undoes and does again; the values before can be reached no more, and are forgotten."""
    tokens = [""]
    for radius in (0.5, 0.6, 0.7, 0.8):
        bpy.ops.stipple.select_sphere("EXEC_DEFAULT", True, center=(-1, 0, 0), radius=radius)
        tokens.append(b_object.data.stipple_capture.edits)
    for index in range(60):
        bpy.ops.ed.undo()
        bpy.ops.stipple.select_sphere("EXEC_DEFAULT", True, center=(-1, 0, 0), radius=0.8 + 0.01 * index)
    assert len(linked_edits._kept) == 4
    for token in tokens[-2::-1]:
        bpy.ops.ed.undo()
        b_now = bpy.data.objects["garden"]
        assert b_now.data.stipple_capture.edits == token
        assert states(b_now).any() == bool(token)
    for _ in range(4):
        bpy.ops.ed.redo()
    assert states(bpy.data.objects["garden"]).any()


def test_states_that_were_seen_twice_can_be_undone(b_object: Any) -> None:
    for index in range(6):
        bpy.ops.stipple.select_sphere("EXEC_DEFAULT", True, center=(-1, 0, 0), radius=0.5 + 0.1 * index)
        bpy.ops.stipple.select_all("EXEC_DEFAULT", True, action="DESELECT")
    for count in (3, 2, 5):
        for _ in range(count):
            bpy.ops.ed.undo()
            states(bpy.data.objects["garden"])
        bpy.ops.stipple.select_sphere("EXEC_DEFAULT", True, center=(1, 0, 0), radius=0.5)
    for _ in range(5):
        bpy.ops.ed.undo()
        states(bpy.data.objects["garden"])
    assert bpy.data.objects["garden"].data.stipple_capture.edits == ""


def test_a_change_of_flags_uploads_no_splats_again(b_object: Any) -> None:
    bpy.ops.stipple.select_sphere(**LEFT)
    bpy.ops.stipple.translate(value=(0, 0, 1))
    first = synced()
    bpy.ops.stipple.select_all(action="INVERT")
    bpy.ops.stipple.delete()
    second = synced()
    assert [a.cloud is b.cloud for a, b in zip(first, second, strict=True)] == [True, True]
    assert sync.settings_from_scene(bpy.context.scene) is not None
