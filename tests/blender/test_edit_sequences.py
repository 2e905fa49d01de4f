# SPDX-License-Identifier: GPL-3.0-or-later
"""Random sequences of edits of splats and of other things, undone and redone in any order: every byte comes back."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest

from stipple.addon.edit import session as sessions

from .captures import add_capture, random_cloud
from .editing import activate, every_byte

pytestmark = pytest.mark.blender
NAMES = ("One", "Two")


def edits(rng: np.random.Generator) -> dict[str, Callable[[], Any]]:
    """Every operator with random values, and edits that know nothing of splats."""
    ops = bpy.ops.stipple

    def point() -> tuple[float, ...]:
        return tuple(rng.uniform(-1, 1, 3))

    def stroke() -> list[dict[str, Any]]:
        return [{"name": "", "location": point(), "radius": float(rng.uniform(0.2, 1))} for _ in range(3)]

    def move_object() -> None:
        bpy.context.object.location = point()

    def script() -> None:
        b_attribute = bpy.context.object.data.attributes["scale"]
        values = np.empty(len(b_attribute.data) * 3, np.float32)
        b_attribute.data.foreach_get("vector", values)
        b_attribute.data.foreach_set("vector", values * np.float32(rng.uniform(0.9, 1.1)))

    return {
        "sphere": lambda: ops.select_sphere(
            center=point(), radius=rng.uniform(0.3, 1.5), mode=str(rng.choice(["SET", "ADD", "XOR"]))
        ),
        "all": lambda: ops.select_all(action=str(rng.choice(["SELECT", "DESELECT", "INVERT"]))),
        "opacity": lambda: ops.select_opacity(low=0.3, high=rng.uniform(0.4, 0.9), mode="ADD"),
        "more": ops.select_more,
        "less": ops.select_less,
        "delete": ops.delete,
        "restore": ops.restore,
        "hide": lambda: ops.hide(unselected=bool(rng.integers(2))),
        "reveal": ops.reveal,
        "lock": ops.lock,
        "unlock": ops.unlock,
        "move": lambda: ops.translate(value=point()),
        "rotate": lambda: ops.rotate(value=rng.uniform(-3, 3), axis=point()),
        "scale": lambda: ops.resize(value=tuple(rng.uniform(0.8, 1.25, 3))),
        "mirror": lambda: ops.mirror(axis=str(rng.choice(list("XYZ")))),
        "duplicate": ops.duplicate,
        "paint": lambda: ops.paint(stroke=stroke(), color=tuple(rng.uniform(0, 1, 3))),
        "fade": lambda: ops.paint(stroke=stroke(), mode="OPACITY", opacity=rng.uniform(0, 1)),
        "clone": lambda: ops.clone(source=point(), stroke=stroke()),
        "faint": lambda: ops.clean_faint(opacity=rng.uniform(0.3, 0.5), action="DELETE"),
        "toggle": ops.edit_mode_toggle,
        "other": lambda: activate(bpy.data.objects[str(rng.choice(NAMES))]),
        "object": move_object,
        "script": script,
        "add": lambda: bpy.ops.mesh.primitive_cube_add() and activate(bpy.data.objects[str(rng.choice(NAMES))]),
    }


def everything() -> dict[str, Any]:
    """All that the edits can change."""
    found: dict[str, Any] = {"objects": sorted(bpy.data.objects.keys())}
    for name in NAMES:
        b_object = bpy.data.objects[name]
        found[name] = (every_byte(b_object.data), tuple(b_object.location), b_object.stipple_editing)
    return found


def begin() -> None:
    for seed, name in enumerate(NAMES):
        activate(add_capture(random_cloud(count=150, degree=seed + 1, seed=seed), name))
        bpy.ops.stipple.edit_mode_toggle()
    bpy.ops.ed.undo_push(message="Start")


def act(seed: int) -> bool:
    """The edit of this seed; whether it ran. One that is refused must leave everything."""
    rng = np.random.default_rng(seed)
    name = str(rng.choice(list(edits(rng))))
    if name in {"paint", "fade"}:
        sessions.free()  # else they build on what an earlier stroke painted over, which is not in the datablock
    before = everything()
    try:
        edits(rng)[name]()
    except RuntimeError:  # it reported why not
        assert everything() == before, name
        return False
    return True


@pytest.mark.parametrize("seed", range(4))
def test_random_edits_undo_redo_and_equal_a_replay(seed: int) -> None:
    rng = np.random.default_rng(seed)
    begin()
    bpy.context.preferences.edit.undo_steps = 64
    states, done, at = [everything()], [], 0
    for number in range(60):
        choice = rng.uniform()
        if choice < 0.25 and at > 0:
            bpy.ops.ed.undo()
            at -= 1
        elif choice < 0.4 and at < len(done):
            bpy.ops.ed.redo()
            at += 1
        elif act(1000 * seed + number):
            bpy.ops.ed.undo_push(message="Step")
            states[at + 1 :], done[at:] = [everything()], [1000 * seed + number]
            at += 1
        assert everything() == states[at]
    assert len(done) > 10
    while at > 0:
        bpy.ops.ed.undo()
        at -= 1
        assert everything() == states[at]
    for expected in states[1:]:
        bpy.ops.ed.redo()
        assert everything() == expected
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    begin()
    assert all([act(one) for one in done])
    assert everything() == states[-1]


def test_a_saved_file_holds_what_the_edits_left(tmp_path: Path) -> None:
    begin()
    for number in range(30):
        act(number)
    expected = everything()
    path = str(tmp_path / "saved.blend")
    bpy.ops.wm.save_as_mainfile(filepath=path)
    bpy.ops.wm.open_mainfile(filepath=path)
    assert everything() == expected
    assert any([act(number) for number in range(30, 40)])
