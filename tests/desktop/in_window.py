# SPDX-License-Identifier: GPL-3.0-or-later
# long: Blender runs it as one program, which has no package to import a second file from
"""Runs inside Blender's window: sets up views, waits for pictures, saves screenshots and measurements, quits.

    blender --python in_window.py -- SCENARIO OUTPUT_FOLDER

The window's own loop goes on between steps: a scenario is a generator that yields what to wait for. Results are written
to OUTPUT_FOLDER/results.json, an error to OUTPUT_FOLDER/error.txt.
"""

from __future__ import annotations

import json
import math
import subprocess
import sys
import time
import traceback
from collections.abc import Callable, Iterator
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
        return import_module(f"{PACKAGE}.addon.residency").worker._sessions[-1]

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


def look(window: Window, kind: str, b_mesh: Any) -> None:
    """Turns the viewport to a perspective, orthographic or camera view that is centred on nothing."""
    b_region_3d, b_camera = window.b_region_3d, bpy.context.scene.camera
    if kind.startswith("CAMERA"):
        b_camera.data.type = "ORTHO" if kind.endswith("ORTHO") else "PERSP"
        b_camera.data.ortho_scale = 7.0
        b_camera.data.shift_x, b_camera.data.shift_y, b_camera.data.passepartout_alpha = 0.13, -0.07, 0.0
        b_region_3d.view_perspective = "CAMERA"
        b_region_3d.view_camera_zoom, b_region_3d.view_camera_offset = 12.0, (0.05, -0.03)
    else:
        b_region_3d.view_perspective = kind
        b_region_3d.view_location, b_region_3d.view_distance = (0.4, 0.2, -0.3), 7.0
    b_mesh.location, b_mesh.rotation_euler, b_mesh.scale = (0.1, 0.2, 0.1), (0.3, 0.2, 0.4), (1.0, 0.7, 1.3)


def alignment(window: Window) -> Steps:
    """A mesh in solid mode and its splat copy in rendered mode, seen alike."""
    use_stipple()
    window.bare()
    b_mesh, b_splats = bpy.data.objects["Cube"], cube_of_splats()
    b_splats.parent = b_mesh
    for kind in ("PERSP", "ORTHO", "CAMERA", "CAMERA_ORTHO"):
        look(window, kind, b_mesh)
        window.b_space.shading.type = "SOLID"
        b_splats.hide_set(True)
        b_mesh.hide_set(False)
        yield from window.rest()
        yield from window.shot(f"{kind}-mesh")
        window.b_space.shading.type = "RENDERED"
        b_splats.hide_set(False)
        yield from window.rest()
        yield from window.shot(f"{kind}-splats")


def final_render(window: Window) -> Steps:
    """The camera view at the size of the final render, and the final render; of a capture, or a cube of splats."""
    method, *capture = sys.argv[sys.argv.index("--") + 3 :]
    b_scene = use_stipple(method)
    b_scene.stipple.samples = b_scene.stipple.viewport_samples = 4
    window.bare()
    bpy.data.objects["Cube"].hide_set(True)
    bpy.data.objects["Cube"].hide_render = True
    if capture:
        bpy.ops.import_scene.splats(filepath=capture[0])
        bpy.context.view_layer.objects.active.select_set(False)
    else:
        cube_of_splats().rotation_euler = (0.3, 0.2, 0.4)
    b_scene.world.node_tree.nodes["Background"].inputs["Color"].default_value = (0.2, 0.05, 0.5, 1)
    yield from compare(window)


def compare(window: Window, frames: tuple[int, ...] = ()) -> Steps:
    """Photographs the camera view at the size of the final render, and makes the final render; after `frames`."""
    b_scene = bpy.context.scene
    b_scene.camera.data.passepartout_alpha = 0.0
    window.b_space.shading.type = "RENDERED"
    window.b_region_3d.view_perspective = "CAMERA"
    window.b_region_3d.view_camera_zoom = (2 - math.sqrt(2)) * 50  # the frame fills the region
    window.b_region_3d.view_camera_offset = (0, 0)
    yield from window.rest()
    b_scene.render.resolution_x, b_scene.render.resolution_y = window.b_region.width, window.b_region.height
    yield from window.rest()
    for frame in frames:
        b_scene.frame_set(frame)
        yield from window.rest()
    yield from window.shot("viewport")
    b_scene.render.image_settings.file_format = "PNG"
    b_scene.render.filepath = str(window.output / "final.png")
    bpy.ops.render.render(write_still=True)


def moving(window: Window) -> Steps:
    """The third file of a sequence, shown by a change of the frame alone, before an image of light around the scene."""
    capture = sys.argv[-1]
    use_stipple()
    window.bare()
    bpy.data.objects["Cube"].hide_set(True)
    bpy.data.objects["Cube"].hide_render = True
    bpy.ops.import_scene.splats(filepath=capture, sequence=True)
    bpy.context.view_layer.objects.active.select_set(False)
    b_image = bpy.data.images.new("sky", 256, 128, float_buffer=True)
    down, around = np.mgrid[0:128, 0:256]
    light = [0.4 + 0.3 * np.sin(around / 128 * np.pi + turn) * np.sin(down / 128 * np.pi) for turn in (0, 2, 4)]
    checks = ((down // 16 + around // 16) % 2)[..., None] * 0.5 + 0.5
    rgba = np.concatenate([np.stack(light, axis=2) * checks, np.ones((128, 256, 1))], axis=2)
    b_image.pixels.foreach_set(rgba.astype(np.float32).reshape(-1))
    b_tree = bpy.context.scene.world.node_tree
    b_texture = b_tree.nodes.new("ShaderNodeTexEnvironment")
    b_texture.image = b_image
    b_tree.links.new(b_texture.outputs["Color"], b_tree.nodes["Background"].inputs["Color"])
    yield from compare(window, frames=(1, 3))


def objects(window: Window) -> Steps:
    """A capture (or a cube of splats) and its settings: each is changed in the open viewport and photographed."""
    capture = sys.argv[sys.argv.index("--") + 3 :]
    use_stipple()
    bpy.context.scene.world.node_tree.nodes["Background"].inputs["Color"].default_value = (0.6, 0.58, 0.53, 1)
    bpy.data.objects.remove(bpy.data.objects["Cube"])
    if capture:
        bpy.ops.import_scene.splats(filepath=capture[0])
        b_object = bpy.context.view_layer.objects.active
    else:
        b_object = cube_of_splats(0.05)
        bpy.context.view_layer.objects.active = b_object
        b_object.select_set(True)
    b_properties = next(a for a in window.b_window.screen.areas if a.type == "PROPERTIES")
    b_properties.spaces.active.context = "OBJECT"
    with bpy.context.temp_override(window=window.b_window, area=window.b_area, region=window.b_region):
        bpy.ops.view3d.view_selected()
        bpy.ops.object.stipple_crop_add()
    window.b_space.shading.type = "RENDERED"
    b_stipple = b_object.stipple
    b_empty = b_stipple.crops[0].object
    residency = import_module(f"{PACKAGE}.addon.residency")
    read, cloud_of = [], residency.CloudCache.cloud_of
    yield from window.rest()

    def counted(cache: Any, b_data: Any, name: str) -> Any:
        read.append(name)
        return cloud_of(cache, b_data, name)

    residency.CloudCache.cloud_of = counted
    b_stipple.crops[0].use = False
    for name, change in (
        ("whole", lambda: None),
        ("exposed", lambda: setattr(b_stipple, "exposure", -1.5)),
        ("cropped", lambda: (setattr(b_stipple, "exposure", 0.0), setattr(b_stipple.crops[0], "use", True))),
        ("moved", lambda: setattr(b_empty, "location", b_empty.location + b_empty.scale * 0.5)),
    ):
        change()
        yield from window.rest()
        yield from window.shot(name)
        window.results[f"{name} light"] = float(window.session.picture.rgba[..., :3].mean())
    window.results["read again"] = len(read)


def latency(window: Window) -> Steps:
    """Camera moves: seconds until the new view is in the viewport's buffer, and what the callbacks take."""
    capture = sys.argv[-1]
    use_stipple()
    bpy.ops.import_scene.splats(filepath=capture)
    bpy.context.view_layer.objects.active.select_set(False)
    window.b_space.overlay.show_overlays = False
    with bpy.context.temp_override(window=window.b_window, area=window.b_area, region=window.b_region):
        bpy.ops.view3d.view_all()
    window.b_space.shading.type = "RENDERED"
    since = time.monotonic()
    yield lambda: time.monotonic() - since > 1.0
    yield from window.rest()
    viewport_class = import_module(f"{PACKAGE}.addon.viewport_draw").Viewport
    draw, callbacks, drawn = viewport_class.draw, [], []

    def timed(self: Any, *arguments: Any) -> None:
        begin = time.perf_counter()
        draw(self, *arguments)
        callbacks.append(time.perf_counter() - begin)
        if self.session._shown.is_set():  # the picture just drawn is of the view just set
            drawn.append(time.perf_counter())

    viewport_class.draw = timed
    first, gaps = [], []
    for _ in range(10):
        drawn.clear()
        begin = time.perf_counter()
        window.b_region_3d.view_rotation.rotate(_turn(window.b_region_3d))
        window.b_area.tag_redraw()
        yield lambda: bool(drawn)
        first.append(drawn[0] - begin)
        yield from window.rest()
    begin = time.perf_counter()
    with bpy.context.temp_override(window=window.b_window, area=window.b_area, region=window.b_region):
        bpy.ops.wm.redraw_timer(type="DRAW_WIN_SWAP", iterations=3)
    gaps.append((time.perf_counter() - begin) / 3)
    viewport_class.draw = draw
    region = [window.b_region.width, window.b_region.height]
    window.results.update(first_shown=first, callbacks=callbacks, redraw=gaps[0], region=region)


def _turn(b_region_3d: Any) -> Any:
    from mathutils import Quaternion

    rotation = b_region_3d.view_rotation
    return (rotation @ Quaternion((0, 1, 0), 0.05)) @ rotation.inverted()


SCENARIOS = {
    "alignment": alignment,
    "final_render": final_render,
    "moving": moving,
    "objects": objects,
    "latency": latency,
}


def main() -> None:
    name, folder = sys.argv[sys.argv.index("--") + 1 :][:2]
    output = Path(folder)
    state: dict[str, Any] = {}

    def tick() -> float | None:
        try:
            if "steps" not in state:
                state["window"] = Window(output)
                state["steps"] = SCENARIOS[name](state["window"])
                state["ready"], state["since"] = next(state["steps"]), time.monotonic()
            while state["ready"]():
                state["ready"], state["since"] = next(state["steps"]), time.monotonic()
            if time.monotonic() - state["since"] > TIMEOUT:
                raise TimeoutError(f"{name}: waited {TIMEOUT} s")
            return TICK
        except StopIteration:
            (output / "results.json").write_text(json.dumps(state["window"].results))
        except BaseException:
            (output / "error.txt").write_text(traceback.format_exc())
        bpy.ops.wm.quit_blender()
        return None

    bpy.context.preferences.view.show_splash = False
    bpy.app.timers.register(tick, first_interval=1.0)


main()
