# SPDX-License-Identifier: GPL-3.0-or-later
"""Inside Blender's window: the 3D view, waiting for pictures, screenshots, scenes; and the loop that runs a scenario.

Scripts that Blender is started with import this and end with `run(SCENARIOS)`:

    blender --python SCRIPT -- SCENARIO OUTPUT_FOLDER [ARGUMENTS]

The window's own loop goes on between steps: a scenario is a generator that yields what to wait for. Results are written
to OUTPUT_FOLDER/results.json, an error to OUTPUT_FOLDER/error.txt.
"""

from __future__ import annotations

import json
import subprocess
import sys
import time
import traceback
from collections.abc import Callable, Iterator, Mapping
from importlib import import_module
from pathlib import Path
from typing import Any

import bpy
import numpy as np

PACKAGE = "bl_ext.user_default.stipple"
TICK, TIMEOUT = 0.02, 120.0  # [s]
Steps = Iterator[Callable[[], bool]]


class Window:
    """The 3D viewport of the first window."""

    def __init__(self, output: Path) -> None:
        self.output = output
        self.results: dict[str, Any] = {}
        self.b_window = bpy.context.window_manager.windows[0]
        self.b_area = next(a for a in self.b_window.screen.areas if a.type == "VIEW_3D")
        self.b_region = next(r for r in self.b_area.regions if r.type == "WINDOW")
        self.b_space = self.b_area.spaces.active
        self.b_region_3d = self.b_region.data

    @property
    def session(self) -> Any:
        sessions = import_module(f"{PACKAGE}.addon.residency").worker._sessions
        return sessions[-1] if sessions else None

    def bare(self) -> None:
        """Only the picture, on black."""
        self.b_space.overlay.show_overlays = False
        for name in ("gizmo", "region_toolbar", "region_header", "region_tool_header", "region_hud", "region_ui"):
            setattr(self.b_space, f"show_{name}", False)
        self.b_space.shading.background_type, self.b_space.shading.background_color = "VIEWPORT", (0, 0, 0)
        self.b_space.shading.light, self.b_space.shading.color_type = "FLAT", "SINGLE"
        self.b_space.shading.single_color = (1, 1, 1)
        bpy.context.preferences.system.viewport_aa = "OFF"  # whose samples are jittered by parts of a pixel

    def rest(self) -> Steps:
        """Until the view is rendered, drawn and left alone."""
        self.b_area.tag_redraw()
        since = time.monotonic()
        yield lambda: time.monotonic() - since > 0.3
        if self.b_space.shading.type == "RENDERED":
            yield lambda: self.session.due() is None and self.session.picture is not None
            yield lambda: self.session.picture is self.session._drawn
        since = time.monotonic()
        yield lambda: time.monotonic() - since > 0.5

    def shot(self, name: str) -> Steps:
        """Photographs the screen from outside: Blender's own screenshots are black under a software rasteriser."""
        process = subprocess.Popen(["import", "-window", "root", str(self.output / f"{name}.png")])
        yield lambda: process.poll() is not None
        b_region = self.b_region
        self.results[name] = [b_region.x, b_region.y, b_region.width, b_region.height]


def cube_of_splats(spacing: float = 0.02) -> Any:
    """An object of small red splats on the surface of the default cube (2 units wide)."""
    splats = import_module(f"{PACKAGE}.engine.splats")
    data = import_module(f"{PACKAGE}.addon.splat_data")
    line = np.arange(-1 + spacing / 2, 1, spacing)
    u, v = (grid.ravel() for grid in np.meshgrid(line, line))
    side = np.ones_like(u)
    faces = [np.roll(np.stack([u, v, sign * side], axis=1), axis, axis=1) for axis in range(3) for sign in (-1, 1)]
    position = np.concatenate(faces).astype(np.float32)
    count = len(position)
    cloud = splats.SplatCloud(
        position=position,
        scale=np.full((count, 3), spacing / 2, np.float32),
        rotation=np.tile(np.array([1, 0, 0, 0], np.float32), (count, 1)),
        opacity=np.full(count, 0.99, np.float32),
        sh_dc=np.tile(np.array([1.7, -1.7, -1.7], np.float32), (count, 1)),
        sh_rest=np.empty((count, 0, 3), np.float32),
        name="splats",
    )
    b_object = bpy.data.objects.new("Splats", data.datablock_from_cloud(cloud, "Splats"))
    bpy.context.scene.collection.objects.link(b_object)
    return b_object


def use_stipple(method: str = "SORTED") -> Any:
    b_scene = bpy.context.scene
    b_scene.render.engine = "STIPPLE"
    b_scene.stipple.method, b_scene.stipple.device = method, "CPU"
    b_scene.view_settings.view_transform = "Standard"
    b_scene.render.dither_intensity = 0.0
    b_scene.world.node_tree.nodes["Background"].inputs["Color"].default_value = (0, 0, 0, 1)
    return b_scene


def run(scenarios: Mapping[str, Callable[[Window], Steps]]) -> None:
    """Runs the scenario that the command line names and quits."""
    name, folder = sys.argv[sys.argv.index("--") + 1 :][:2]
    output = Path(folder)
    state: dict[str, Any] = {}

    def tick() -> float | None:
        try:
            if "steps" not in state:
                state["window"] = Window(output)
                state["steps"] = scenarios[name](state["window"])
                state["ready"], state["since"] = next(state["steps"]), time.monotonic()
            while state["ready"]():
                state["ready"], state["since"] = next(state["steps"]), time.monotonic()
            if time.monotonic() - state["since"] > TIMEOUT:
                raise TimeoutError(f"{name}: waited {TIMEOUT} s")
            return TICK
        except StopIteration:
            (output / "results.json").write_text(json.dumps(state["window"].results))
        except BaseException:
            found = state["window"].results if "window" in state else {}
            (output / "error.txt").write_text(f"{traceback.format_exc()}until then: {json.dumps(found)}\n")
        bpy.ops.wm.quit_blender()
        return None

    bpy.context.preferences.view.show_splash = False
    bpy.app.timers.register(tick, first_interval=1.0)
