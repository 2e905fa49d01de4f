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
from stipple.addon.splat_data import is_capture_object

from .captures import add_camera, add_capture, random_cloud
from .editing import activate, every_byte

pytestmark = pytest.mark.blender
NAMES = ("One", "Two")


def point(rng: np.random.Generator) -> tuple[float, ...]:
    return tuple(rng.uniform(-1, 1, 3))


def selections(rng: np.random.Generator) -> dict[str, Callable[[], Any]]:
    """Every operator that selects, with random values; through the camera where it needs a view."""
    ops, screen = bpy.ops.stipple, {"camera": "Camera"}

    def some(limit: int) -> int:
        return int(rng.integers(limit))

    def corner() -> dict[str, Any]:
        return {"name": "", "loc": (some(1920), some(1080)), "time": 0}

    return {
        "sphere": lambda: ops.select_sphere(
            center=point(rng), radius=rng.uniform(0.3, 1.5), mode=str(rng.choice(["SET", "ADD", "XOR"]))
        ),
        "box": lambda: ops.select_box(**screen, xmin=some(960), xmax=some(1920), ymin=some(500), ymax=some(1080)),
        "circle": lambda: ops.select_circle(**screen, x=some(1920), y=some(1080), radius=300, visible_only=True),
        "lasso": lambda: ops.select_lasso(**screen, path=[corner() for _ in range(5)]),
        "depth": lambda: ops.select_depth(**screen, near=rng.uniform(2, 4), far=rng.uniform(4, 6), mode="AND"),
        "color": lambda: ops.select_color(color=tuple(rng.uniform(0, 1, 3)), threshold=0.3, mode="ADD"),
        "opacity": lambda: ops.select_opacity(low=0.3, high=rng.uniform(0.4, 0.9), mode="ADD"),
        "size": lambda: ops.select_size(low=0.04, high=rng.uniform(0.05, 0.2), mode="SUB"),
        "linked": lambda: ops.select_linked(splat=some(150), distance=1.5, mode="ADD"),
        "floaters": lambda: ops.clean_floaters(factor=rng.uniform(1, 3), action="SELECT"),
        "all": lambda: ops.select_all(action=str(rng.choice(["SELECT", "DESELECT", "INVERT"]))),
        "more": ops.select_more,
        "less": ops.select_less,
    }


def changes(rng: np.random.Generator) -> dict[str, Callable[[], Any]]:
    """Every operator that changes splats, with random values."""
    ops = bpy.ops.stipple

    def stroke() -> list[dict[str, Any]]:
        return [{"name": "", "location": point(rng), "radius": float(rng.uniform(0.2, 1))} for _ in range(3)]

    return {
        "delete": ops.delete,
        "restore": ops.restore,
        "hide": lambda: ops.hide(unselected=bool(rng.integers(2))),
        "reveal": ops.reveal,
        "lock": ops.lock,
        "unlock": ops.unlock,
        "move": lambda: ops.translate(value=point(rng)),
        "rotate": lambda: ops.rotate(value=rng.uniform(-3, 3), axis=point(rng)),
        "scale": lambda: ops.resize(value=tuple(rng.uniform(0.8, 1.25, 3))),
        "mirror": lambda: ops.mirror(axis=str(rng.choice(list("XYZ")))),
        "duplicate": ops.duplicate,
        "separate": ops.separate,
        "paint": lambda: ops.paint(stroke=stroke(), color=tuple(rng.uniform(0, 1, 3))),
        "fade": lambda: ops.paint(stroke=stroke(), mode="OPACITY", opacity=rng.uniform(0, 1)),
        "clone": lambda: ops.clone(source=point(rng), stroke=stroke()),
        "faint": lambda: ops.clean_faint(opacity=rng.uniform(0.3, 0.5), action="DELETE"),
    }


def edits(rng: np.random.Generator) -> dict[str, Callable[[], Any]]:
    """Selections, changes, edits of whole objects, and some that know nothing of splats."""

    def join() -> None:
        for name in NAMES:
            if name in bpy.data.objects:
                bpy.data.objects[name].select_set(True)
        bpy.ops.stipple.join()

    def move_object() -> None:
        bpy.context.object.location = point(rng)

    def script() -> None:
        b_attribute = bpy.context.object.data.attributes["scale"]
        values = np.empty(len(b_attribute.data) * 3, np.float32)
        b_attribute.data.foreach_get("vector", values)
        b_attribute.data.foreach_set("vector", values * np.float32(rng.uniform(0.9, 1.1)))

    return {
        **selections(rng),
        **changes(rng),
        "join": join,
        "toggle": bpy.ops.stipple.edit_mode_toggle,
        "other": lambda: activate(one_of(rng)),
        "object": move_object,
        "script": script,
        "add": lambda: bpy.ops.mesh.primitive_cube_add() and activate(one_of(rng)),
    }


def one_of(rng: np.random.Generator) -> Any:
    """One of the captures, of which joining may have left one."""
    return bpy.data.objects[str(rng.choice([name for name in NAMES if name in bpy.data.objects]))]


def everything() -> dict[str, Any]:
    """All that the edits can change."""
    found: dict[str, Any] = {"objects": sorted(bpy.data.objects.keys())}
    for b_object in bpy.data.objects:
        name = b_object.name
        if not is_capture_object(b_object):
            continue
        found[name] = (every_byte(b_object.data), tuple(b_object.location), b_object.stipple_editing)
    return found


def begin() -> None:
    add_camera()
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


def act_on_one(seed: int) -> bool:
    """An edit of the splats of one capture, often a stroke; sessions stay, with what they know is under the paint."""
    rng = np.random.default_rng(seed)
    found = selections(rng) | changes(rng)
    stroke = [{"name": "", "location": point(rng), "radius": 0.8}]
    strokes = {
        "paint": found["paint"],
        "fade": found["fade"],
        "erase": lambda: bpy.ops.stipple.paint(stroke=stroke, mode="ERASE"),
        "darken": lambda: bpy.ops.stipple.paint(stroke=stroke, mode="DARKEN", strength=0.5),
    }
    chosen = strokes if rng.uniform() < 0.6 else found
    try:
        return bool(chosen[str(rng.choice(list(chosen)))]() == {"FINISHED"})
    except RuntimeError:
        return False


@pytest.mark.parametrize("seed", range(4))
def test_strokes_build_on_what_is_under_the_paint_after_undo(seed: int) -> None:
    """Erasing and painting over after undo and redo give the bits of a session in which nothing was undone."""
    rng = np.random.default_rng(seed)
    begin()
    bpy.context.preferences.edit.undo_steps = 64
    done: list[int] = []
    at = 0
    for number in range(60):
        choice = rng.uniform()
        if choice < 0.25 and at > 0:
            bpy.ops.ed.undo()
            at -= 1
        elif choice < 0.35 and at < len(done):
            bpy.ops.ed.redo()
            at += 1
        elif act_on_one(1000 * seed + number):
            bpy.ops.ed.undo_push(message="Step")
            done[at:] = [1000 * seed + number]
            at += 1
    for _ in range(at, len(done)):
        bpy.ops.ed.redo()
    expected = everything()
    assert len(done) > 10
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    begin()
    assert all([act_on_one(one) for one in done])
    assert everything() == expected


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
