# SPDX-License-Identifier: GPL-3.0-or-later
"""Keys and mouse for scenarios of Edit Splats, and what they find in the edited capture; imported inside Blender."""

from __future__ import annotations

import subprocess
import time
import zlib
from importlib import import_module
from typing import Any

import bpy
import numpy as np
from mathutils import Euler
from window import PACKAGE


class Hand:
    """Keys and mouse, from outside Blender."""

    def __init__(self, window: Any) -> None:
        self._window = window

    def do(self, *commands: str, settle: bool = True) -> Any:
        """xdotool commands one after the other, each with time for Blender to notice; then the view at rest."""
        for command in commands:
            process = subprocess.Popen(["xdotool", *command.split()])
            yield lambda process=process: process.poll() is not None
            since = time.monotonic()
            yield lambda since=since: time.monotonic() - since > 0.15
        if settle:
            yield from self._window.rest()

    def at(self, x: float, y: float) -> str:
        """A mouse move to a place in the region [fractions from the bottom left]."""
        b_region, b_window = self._window.b_region, self._window.b_window
        return (
            f"mousemove {b_region.x + x * b_region.width:.0f} {b_window.height - b_region.y - y * b_region.height:.0f}"
        )

    def on_icon(self, below: int) -> str:
        """A mouse move to an icon of the toolbar, `below` the upper edge of the 3D view [px]."""
        b_area, b_window = self._window.b_area, self._window.b_window
        return f"mousemove {b_area.x + 28} {b_window.height - b_area.y - b_area.height + below}"

    def close_error(self) -> Any:
        """Its box would take the next key."""
        yield from self.do("key Escape", self.at(0.3, 0.3), self.at(0.5, 0.5))

    def drag(self, *places: tuple[float, float], modifier: str = "") -> Any:
        """Left button down at the first place and up at the last, with a modifier key held meanwhile."""
        moves = [self.at(*places[0]), "mousedown 1", *(self.at(*place) for place in places[1:]), "mouseup 1"]
        if modifier:
            moves = [moves[0], f"keydown {modifier}", *moves[1:], f"keyup {modifier}"]
        yield from self.do(*moves)


def flags(bit: int) -> int:
    """How many points of the active object have a flag."""
    b_attribute = bpy.context.object.data.attributes.get("stipple_state")
    if b_attribute is None:
        return 0
    values = np.empty(len(b_attribute.data), np.int32)
    b_attribute.data.foreach_get("value", values)
    return int(np.count_nonzero(values & bit))


def splat_count() -> int:
    """Points of the active object."""
    return len(bpy.context.object.data.attributes["position"].data)


def chosen_positions() -> np.ndarray:
    """Of the selected splats of the active object, in the world (N, 3)."""
    placed = np.array(bpy.context.object.matrix_world)
    b_attributes = bpy.context.object.data.attributes
    states, places = np.empty(splat_count(), np.int32), np.empty(splat_count() * 3, np.float32)
    b_attributes["stipple_state"].data.foreach_get("value", states)
    b_attributes["position"].data.foreach_get("vector", places)
    return places.reshape(-1, 3)[states & 1 != 0] @ placed[:3, :3].T + placed[:3, 3]


def digest() -> tuple[int, ...]:
    """Of what the active object's splats are, harmonics included where there are some."""
    b_attributes = bpy.context.object.data.attributes
    found = []
    names = sorted(b_attribute.name for b_attribute in b_attributes)
    for name in [name for name in names if name == "position" or name.startswith("radiance:")]:
        width = 4 if name == "radiance:base" else 3
        values = np.empty(len(b_attributes[name].data) * width, np.float32)
        b_attributes[name].data.foreach_get("vector", values)
        found.append(zlib.crc32(values))
    return tuple(found)


def _prepare(window: Any, capture: str, link: bool) -> None:
    """The capture alone in the rendered view, the add-on's sidebar open."""
    bpy.context.scene.world.node_tree.nodes["Background"].inputs["Color"].default_value = (0.18, 0.18, 0.18, 1)
    bpy.ops.object.select_all(action="SELECT")
    bpy.ops.object.delete()
    bpy.ops.import_scene.splats(filepath=capture, link=link)
    window.b_space.show_region_ui = True
    window.b_space.shading.type = "RENDERED"
    with bpy.context.temp_override(window=window.b_window, area=window.b_area, region=window.b_region):
        bpy.ops.view3d.view_selected()
    window.b_region_3d.view_perspective = "PERSP"
    window.b_region_3d.view_rotation = Euler((1.35, 0, 0.5)).to_quaternion()


def _show_sidebar(window: Any) -> None:
    """The tab *Stipple*, which can be chosen once the sidebar has been drawn."""
    for b_region in window.b_area.regions:
        if b_region.type == "UI":
            b_region.active_panel_category = "Stipple"


def begin_editing(window: Any, hand: Hand, capture: str, link: bool = False) -> Any:
    """E over the capture, imported or linked, and until the kernels of edits are there.

    What a key does before goes to the results.
    """
    _prepare(window, capture, link)
    yield from window.rest()
    _show_sidebar(window)
    kernels = import_module(f"{PACKAGE}.addon.edit.kernels")
    yield from hand.do(hand.at(0.5, 0.5), "key e", settle=False)
    if not kernels.is_ready("cpu"):
        yield from hand.do("key a", settle=False)
        yield from window.shot("editing-early")
        window.results["selected too early"] = flags(1)
        yield from hand.close_error()
    yield lambda: kernels.is_ready("cpu")
    yield from window.rest()


def choose_tool(window: Any, name: str) -> None:
    with bpy.context.temp_override(window=window.b_window, area=window.b_area, region=window.b_region):
        bpy.ops.wm.tool_set_by_id(name=name)
