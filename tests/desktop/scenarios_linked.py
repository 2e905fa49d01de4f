# SPDX-License-Identifier: GPL-3.0-or-later
"""Edit Splats on a linked capture by keys and mouse. The screenshot is that of docs/large-captures.md."""

from __future__ import annotations

import shutil
import sys
from importlib import import_module
from pathlib import Path
from typing import Any

import bpy

sys.path.insert(0, str(Path(__file__).resolve().parent))
from hand import Hand, begin_editing, choose_tool
from window import PACKAGE, Steps, Window, run, use_stipple


def show_panel(window: Any) -> None:
    for b_area in window.b_window.screen.areas:
        if b_area.type == "PROPERTIES":
            b_area.spaces.active.context = "DATA"


def counts() -> dict[str, int]:
    edits = import_module(f"{PACKAGE}.addon.linked_edits").found_edits(bpy.context.object.data, "capture")
    if edits is None:
        return {"selected": 0, "deleted": 0, "painted": 0, "moved": 0}
    arrays = edits.edits.arrays
    rows = {name: len(arrays.get(f"{name}_rows", ())) for name in ("painted", "moved")}
    return edits.edits.counts | rows


def linked(window: Window) -> Steps:
    """Select, delete, undo, move, paint and save."""
    capture = window.output / "garden.ply"
    shutil.copyfile(sys.argv[-1], capture)
    use_stipple()
    hand, results = Hand(window), window.results
    yield from begin_editing(window, hand, str(capture), link=True)
    yield from hand.do("key b")
    yield from hand.drag((0.38, 0.62), (0.5, 0.8), (0.62, 0.95))
    results["selected"] = counts()
    yield from hand.do("key g", "key z", "key period", "key 1", "key 5", "key Return")
    results["moved"] = counts()
    yield from hand.do("key ctrl+z")
    results["move undone"] = counts()
    yield from hand.do("key x")
    results["deleted"] = counts()
    window.b_space.shading.type = "SOLID"
    yield from window.rest()
    yield from window.shot("linked-capture-solid")
    window.b_space.shading.type = "RENDERED"
    yield from window.rest()
    choose_tool(window, "stipple.paint_tool")
    bpy.context.scene.stipple_edit.color, bpy.context.scene.stipple_edit.radius = (0.9, 0.25, 0.1), 30
    yield from hand.drag((0.44, 0.42), (0.47, 0.44), (0.5, 0.44), (0.53, 0.42), (0.56, 0.4))
    results["painted"] = counts()
    bpy.ops.wm.save_as_mainfile(filepath=str(window.output / "shot.blend"))
    results["files"] = sorted(path.name for path in window.output.glob("*edits*"))
    show_panel(window)
    yield from window.rest()
    yield from window.shot("linked-capture-edits")
    yield from hand.do("key ctrl+z")
    results["paint undone"] = counts()


if __name__ == "__main__":
    run({"linked": linked})
