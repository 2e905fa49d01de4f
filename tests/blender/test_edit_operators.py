# SPDX-License-Identifier: GPL-3.0-or-later
"""What holds for all operators of Edit Splats: bad calls change nothing and say why, and every operator is tried."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import bpy
import numpy as np
import pytest

from stipple.addon import splat_data
from stipple.addon.edit import operator
from stipple.addon.edit import session as sessions
from stipple.addon.edit.operator import SplatOperator
from stipple.engine.edit.state import SELECTED

from .captures import add_camera, add_capture, random_cloud
from .editing import activate, edited, every_byte, flags, positions, refused

pytestmark = pytest.mark.blender

STROKE = [{"name": "", "location": (0.2, 0, 0), "radius": 0.6}]
SCREEN = {"camera": "Camera"}
# Operators and what they are called with.
ON_SELECTION: dict[str, dict[str, Any]] = {
    "delete": {},
    "hide": {},
    "lock": {},
    "select_more": {},
    "select_less": {},
    "select_linked": {"splat": -1},
    "translate": {"value": (1, 0, 0)},
    "rotate": {"value": 0.3},
    "resize": {"value": (2, 2, 2)},
    "mirror": {"axis": "X"},
    "shear": {"angle": 0.3},
    "duplicate": {},
    "separate": {},
    "paint": {"stroke": STROKE, "selected_only": True},
}
ON_ALL: dict[str, dict[str, Any]] = {
    "select_all": {"action": "INVERT"},
    "select_sphere": {"center": (0, 0, 0), "radius": 0.7},
    "select_plane": {"point": (0.2, 0, 0), "normal": (1, 1, 0)},
    "select_in_object": {"object": "Box"},
    "select_opacity": {"low": 0.5, "high": 0.9},
    "select_size": {"low": 0.01, "high": 0.06},
    "select_depth": SCREEN | {"near": 3.0, "far": 4.0},
    "select_box": SCREEN | {"xmin": 0, "xmax": 960, "ymin": 0, "ymax": 540},
    "select_circle": SCREEN | {"x": 960, "y": 540, "radius": 200},
    "select_lasso": SCREEN | {"path": [{"name": "", "loc": at, "time": 0} for at in ((0, 0), (900, 0), (900, 900))]},
    "select_color": {"color": (0.5, 0.5, 0.5), "threshold": 0.3},
    "clean_floaters": {"factor": 1.0, "action": "DELETE"},
    "clean_oversized": {"size": 0.06, "action": "DELETE"},
    "clean_faint": {"opacity": 0.5, "action": "DELETE"},
    "clean_outside": {"object": "Box", "action": "DELETE"},
    "paint": {"stroke": STROKE, "color": (0.9, 0.1, 0.1)},
    "clone": {"source": (-0.3, 0, 0), "stroke": STROKE},
}
# Tried elsewhere: they bring back, set a place, open a menu, or act on whole objects and files.
OTHERS = {
    "restore", "reveal", "unlock", "clone_source", "duplicate_move", "call_menu", "brush_control", "edit_mode_toggle",
    "delete_invalid", "join", "align_points", "apply_edits", "discard_edits",
}  # fmt: skip
EVERY = {**ON_ALL, **ON_SELECTION, "paint all": ON_ALL["paint"]}


def run(name: str) -> Any:
    return getattr(bpy.ops.stipple, name.partition(" ")[0])(**EVERY[name])


def scene() -> Any:
    """An edited capture with some splats selected, a camera and a box."""
    b_box = bpy.data.objects.new("Box", None)
    b_box.scale = (0.6, 0.6, 0.6)
    bpy.context.scene.collection.objects.link(b_box)
    add_camera()
    b_object = edited(random_cloud(count=300, degree=1))
    bpy.ops.stipple.select_sphere(center=(0.3, 0, 0), radius=0.8)
    bpy.ops.ed.undo_push(message="Select")
    assert 20 < flags(b_object, SELECTED).sum() < 280
    return b_object


def everything() -> Any:
    """What every capture holds."""
    return {b_data.name: every_byte(b_data) for b_data in (*bpy.data.pointclouds, *bpy.data.meshes)}


def test_every_operator_is_tried_here_or_named() -> None:
    known = {name for name in dir(bpy.ops.stipple) if not name.startswith("_")}
    assert known == ON_ALL.keys() | ON_SELECTION.keys() | OTHERS


def test_who_goes_on_has_an_invoke_of_its_own() -> None:
    for name in ON_ALL.keys() | ON_SELECTION.keys():
        cls = getattr(bpy.types, f"STIPPLE_OT_{name}")
        assert hasattr(cls, "modal") == (cls.invoke is not SplatOperator.invoke) or name in {
            "select_linked",
            "select_color",
        }


@pytest.mark.parametrize("name", EVERY)
def test_it_works_and_undo_brings_every_byte_back(name: str) -> None:
    scene()
    before = everything()
    assert run(name) == {"FINISHED"}
    bpy.ops.ed.undo_push(message="Step")
    assert everything() != before
    bpy.ops.ed.undo()
    assert everything() == before


@pytest.mark.parametrize("name", ON_SELECTION)
def test_nothing_selected(name: str) -> None:
    scene()
    bpy.ops.stipple.select_all(action="DESELECT")
    before = everything()
    with refused("Capture", "nothing is selected"):
        run(name)
    assert everything() == before


@pytest.mark.parametrize("name", EVERY)
def test_another_object_or_a_capture_that_is_not_edited(name: str) -> None:
    scene()
    before = everything()
    activate(bpy.data.objects["Box"])
    bpy.data.objects["Capture"].select_set(True)
    with refused("Edit the splats of a capture first"):
        run(name)
    assert everything() == before
    b_other = add_capture(random_cloud(50, 1), "Other")
    before = everything()
    activate(b_other)
    with refused("Edit the splats of a capture first"):
        run(name)
    assert everything() == before


def test_data_of_another_file(tmp_path: Path) -> None:
    """An object may come from a library in the middle of being edited."""
    scene()
    bpy.data.libraries.write(str(tmp_path / "library.blend"), {bpy.data.objects["Capture"]})
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    with bpy.data.libraries.load(str(tmp_path / "library.blend"), link=True) as (_, into):
        into.objects = ["Capture"]
    bpy.context.scene.collection.objects.link(into.objects[0])
    add_camera()
    activate(into.objects[0])
    before = everything()
    assert into.objects[0].stipple_editing
    for name in EVERY:
        with refused("Capture", "make it local"):
            run(name)
    with refused("Capture", "make it local"):
        bpy.ops.stipple.restore()
    assert everything() == before


class Failing:
    """Writes as it should, and runs out of memory after the nth time."""

    def __init__(self, at: int, monkeypatch: pytest.MonkeyPatch) -> None:
        self.calls, self._at = 0, at
        for module, name in ((splat_data, "write_attribute"), (sessions, "write_states")):
            monkeypatch.setattr(module, name, self._wrapped(getattr(module, name)))

    def _wrapped(self, write: Callable[..., None]) -> Callable[..., None]:
        def wrapped(*arguments: Any) -> None:
            write(*arguments)
            self.calls += 1
            if self.calls == self._at:
                raise MemoryError

        return wrapped


@pytest.mark.parametrize("name", EVERY)
def test_out_of_memory_in_the_middle(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    scene()
    before, objects = everything(), list(bpy.data.objects)
    at = 0
    while True:
        at += 1
        with monkeypatch.context() as patch:
            failing = Failing(at, patch)
            if failing_is_over(name, failing, at):
                break
        assert everything() == before and list(bpy.data.objects) == objects, at
    assert at > 1 and everything() != before


def failing_is_over(name: str, failing: Failing, at: int) -> bool:
    """Whether the operator came to its end."""
    try:
        run(name)
    except RuntimeError as error:
        assert "memory" in str(error)
        return False
    assert failing.calls < at
    return True


def test_what_brings_back_has_something_to_bring() -> None:
    scene()
    before = everything()
    for name, word in (("restore", "deleted"), ("reveal", "hidden"), ("unlock", "locked")):
        with refused("Capture", word):
            getattr(bpy.ops.stipple, name)()
    assert everything() == before


def test_a_clone_source_is_kept_for_the_next_stroke() -> None:
    scene()
    assert bpy.ops.stipple.clone_source(location=(0.1, 0.2, 0.3)) == {"FINISHED"}
    b_settings = bpy.context.scene.stipple_edit
    assert b_settings.has_clone_source and np.allclose(b_settings.clone_source, (0.1, 0.2, 0.3))


def test_by_hand_what_was_undone_or_tagged_meanwhile_is_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    """Operators that users invoke compare arrays only after an undo or a tag, and then they must."""
    # Without a window Blender executes what is to be invoked.
    monkeypatch.setattr(operator, "session_of", lambda *arguments: sessions.session_of(*arguments[:3], by_hand=True))
    compared = []
    key_of = sessions.key_of
    monkeypatch.setattr(sessions, "key_of", lambda *arguments: compared.append(arguments) or key_of(*arguments))
    b_object, ops = edited(random_cloud(300)), bpy.ops.stipple
    ops.select_all(action="SELECT")
    bpy.ops.ed.undo_push(message="Selected")
    before = positions(b_object)
    compared.clear()
    ops.mirror(axis="X")
    bpy.ops.ed.undo_push(message="Mirrored")
    mirrored = positions(b_object)
    assert not np.array_equal(before, mirrored) and not compared
    bpy.ops.ed.undo()
    b_object = bpy.context.object
    ops.mirror(axis="X")
    assert np.array_equal(positions(b_object), mirrored) and len(compared) == 1
    ops.mirror(axis="Y")
    assert len(compared) == 1
    b_object.data.attributes["position"].data.foreach_set("vector", (before + np.float32(0.5)).ravel())
    b_object.data.update_tag()
    ops.mirror(axis="X")
    np.testing.assert_allclose(positions(b_object)[:, 1:], before[:, 1:] + 0.5, atol=1e-5)


def test_an_operator_from_a_script_sees_what_the_script_wrote_and_did_not_tag() -> None:
    b_object = edited(random_cloud(300))
    ops = bpy.ops.stipple
    ops.select_all(action="SELECT")
    before = positions(b_object)
    b_object.data.attributes["position"].data.foreach_set("vector", (before + np.float32(0.5)).ravel())
    ops.mirror(axis="X")
    np.testing.assert_allclose(positions(b_object)[:, 1:], before[:, 1:] + 0.5, atol=1e-5)


def test_what_is_invoked_is_executed_and_known_to_be_by_hand() -> None:
    """Operators that do more than a step have an `execute` of their own. In the background Blender invokes nothing."""
    executed = []
    stand_in = SimpleNamespace(execute=lambda context: executed.append(context) or {"FINISHED"}, by_hand=False)
    assert SplatOperator.invoke(stand_in, bpy.context, None) == {"FINISHED"}  # type: ignore[arg-type]
    assert len(executed) == 1 and stand_in.by_hand
