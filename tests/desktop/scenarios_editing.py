# SPDX-License-Identifier: GPL-3.0-or-later
"""Edit Splats by keys and mouse in Blender's window. The screenshots are those of docs/editing.md."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import bpy

sys.path.insert(0, str(Path(__file__).resolve().parent))
from hand import Hand, begin_editing, choose_tool, digest, flags
from window import Steps, Window, run, use_stipple


def select_and_move(window: Any, hand: Hand) -> Any:
    results = window.results
    before = digest()
    yield from hand.do("key b")
    yield from hand.drag((0.38, 0.62), (0.5, 0.8), (0.62, 0.95))
    results["selected"] = flags(1)
    yield from window.shot("editing-select")
    yield from hand.do("key x")
    results["deleted"] = flags(4)
    yield from window.shot("editing-delete")
    yield from hand.do("key ctrl+z")
    results["deleted after undo"] = flags(4)
    yield from hand.do("key g", hand.at(0.7, 0.5), "key Escape")
    results["same after escape"] = digest() == before
    yield from hand.do("key g", "key z", "key period", "key 1", "key 5", "key Return")
    results["moved"] = digest() != before
    yield from window.shot("editing-move")
    yield from hand.do("key ctrl+z")
    results["same after undoing the move"] = digest() == before


def paint(window: Any, hand: Hand) -> Any:
    results, before = window.results, digest()
    yield from hand.do("key alt+a")
    results["selected after Alt-A"] = flags(1)
    choose_tool(window, "stipple.paint_tool")
    bpy.context.scene.stipple_edit.radius = 24
    yield from hand.drag((0.45, 0.6), (0.48, 0.63), (0.5, 0.63), (0.53, 0.65), (0.56, 0.66))
    results["painted"] = digest() != before
    yield from window.shot("editing-paint")
    yield from hand.do("key ctrl+z")
    results["same after undoing the paint"] = digest() == before
    yield from hand.do("key ctrl+shift+z")
    results["painted again"] = digest() != before


def brushes(window: Any, hand: Hand) -> Any:
    """C, F, Shift-D, R and Alt-H, each as in Blender's own modes."""
    results, b_settings = window.results, bpy.context.scene.stipple_edit
    choose_tool(window, "builtin.select_box")
    yield from hand.do(hand.at(0.39, 0.52), "key c", "mousedown 1", hand.at(0.41, 0.53), "mouseup 1", "key Return")
    results["circle"] = flags(1)
    count = len(bpy.context.object.data.attributes["position"].data)
    yield from hand.do("key shift+d", "key x", "key minus", "key period", "key 3", "key Return")
    results["copied"] = len(bpy.context.object.data.attributes["position"].data) - count
    yield from hand.do("key r", "key z", "key 4", "key 5", "key Return")
    yield from window.shot("editing-duplicate")
    yield from hand.do("key h")
    results["hidden"] = flags(2)
    yield from hand.do("key alt+h")
    results["hidden after Alt-H"] = flags(2)
    radius = b_settings.radius
    yield from hand.do(hand.at(0.5, 0.5), "key f", hand.at(0.6, 0.5), "click 1")
    results["radius"] = [radius, b_settings.radius]
    yield from hand.do("key ctrl+z", "key ctrl+z", "key ctrl+z", "key ctrl+z", "key ctrl+z")
    results["copies after undo"] = len(bpy.context.object.data.attributes["position"].data) - count


def editing(window: Window) -> Steps:
    """Select, delete, undo, move, paint and save a capture."""
    use_stipple()
    hand, results = Hand(window), window.results
    yield from begin_editing(window, hand, sys.argv[-1])
    results["editing"] = bpy.context.object.stipple_editing
    yield from select_and_move(window, hand)
    yield from paint(window, hand)
    painted = digest()
    yield from brushes(window, hand)
    bpy.ops.wm.save_as_mainfile(filepath=str(window.output / "edited.blend"))
    results["saved"] = (window.output / "edited.blend").stat().st_size
    yield from hand.do("key e")
    results["left"] = not bpy.context.object.stipple_editing and digest() == painted


if __name__ == "__main__":
    run({"editing": editing})
