# SPDX-License-Identifier: GPL-3.0-or-later
"""Edit Splats by keys and mouse in Blender's window. The screenshots are those of docs/editing.md."""

from __future__ import annotations

import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import bpy
import numpy as np
from mathutils import Euler

sys.path.insert(0, str(Path(__file__).resolve().parent))
from window import Steps, Window, run, use_stipple


class Hand:
    """Keys and mouse, from outside Blender."""

    def __init__(self, window: Any) -> None:
        self._window = window

    def do(self, *commands: str) -> Any:
        """xdotool commands one after the other, each with time for Blender to notice; then the view at rest."""
        for command in commands:
            process = subprocess.Popen(["xdotool", *command.split()])
            yield lambda process=process: process.poll() is not None
            since = time.monotonic()
            yield lambda since=since: time.monotonic() - since > 0.15
        yield from self._window.rest()

    def at(self, x: float, y: float) -> str:
        """A mouse move to a place in the region [fractions from the bottom left]."""
        b_region, b_window = self._window.b_region, self._window.b_window
        return (
            f"mousemove {b_region.x + x * b_region.width:.0f} {b_window.height - b_region.y - y * b_region.height:.0f}"
        )

    def drag(self, *places: tuple[float, float]) -> Any:
        """Left button down at the first place and up at the last."""
        yield from self.do(self.at(*places[0]), "mousedown 1", *(self.at(*place) for place in places[1:]), "mouseup 1")


def flags(bit: int) -> int:
    """How many points of the active object have a flag."""
    b_attribute = bpy.context.object.data.attributes.get("stipple_state")
    if b_attribute is None:
        return 0
    values = np.empty(len(b_attribute.data), np.int32)
    b_attribute.data.foreach_get("value", values)
    return int(np.count_nonzero(values & bit))


def digest() -> tuple[int, ...]:
    """Of every attribute of the active object."""
    import zlib

    found = []
    for name, element, width in (
        ("position", "vector", 3),
        ("radiance:base", "vector", 4),
        ("radiance:sh_0", "vector", 3),
    ):
        b_attribute = bpy.context.object.data.attributes[name]
        values = np.empty(len(b_attribute.data) * width, np.float32)
        b_attribute.data.foreach_get(element, values)
        found.append(zlib.crc32(values))
    return tuple(found)


def prepare(window: Any, b_scene: Any, capture: str) -> None:
    """The capture alone in the rendered view, the add-on's sidebar open."""
    b_scene.world.node_tree.nodes["Background"].inputs["Color"].default_value = (0.18, 0.18, 0.18, 1)
    bpy.ops.object.select_all(action="SELECT")
    bpy.ops.object.delete()
    bpy.ops.import_scene.splats(filepath=capture)
    window.b_space.show_region_ui = True
    window.b_space.shading.type = "RENDERED"
    with bpy.context.temp_override(window=window.b_window, area=window.b_area, region=window.b_region):
        bpy.ops.view3d.view_selected()
    window.b_region_3d.view_perspective = "PERSP"
    window.b_region_3d.view_rotation = Euler((1.35, 0, 0.5)).to_quaternion()


def show_sidebar(window: Any) -> None:
    """The tab *Stipple*, which can be chosen once the sidebar has been drawn."""
    for b_region in window.b_area.regions:
        if b_region.type == "UI":
            b_region.active_panel_category = "Stipple"


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
    with bpy.context.temp_override(window=window.b_window, area=window.b_area, region=window.b_region):
        bpy.ops.wm.tool_set_by_id(name="stipple.paint_tool")
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
    with bpy.context.temp_override(window=window.b_window, area=window.b_area, region=window.b_region):
        bpy.ops.wm.tool_set_by_id(name="builtin.select_box")
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
    prepare(window, use_stipple(), sys.argv[-1])
    yield from window.rest()
    show_sidebar(window)
    hand, results = Hand(window), window.results
    yield from hand.do(hand.at(0.5, 0.5), "key e")
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
