# SPDX-License-Identifier: GPL-3.0-or-later
"""The part of guide_pictures.py that runs inside Blender's window."""

from __future__ import annotations

import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import bpy
import numpy as np
from mathutils import Euler

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests" / "desktop"))
from window import Steps, Window, cube_of_splats, run

PROPERTIES_WIDTH = 400  # [px] so that no label is cut off
GRAY = (0.35, 0.34, 0.32, 1)


def override(window: Window, **more: Any) -> Any:
    return bpy.context.temp_override(window=window.b_window, area=window.b_area, region=window.b_region, **more)


def hand(*commands: str) -> Steps:
    """xdotool commands, each with time for Blender to answer."""
    for command in commands:
        subprocess.run(["xdotool", *command.split()], check=True)
        since = time.monotonic()
        yield lambda since=since: time.monotonic() - since > 0.8


def properties_editor(window: Window) -> Any:
    return next(b_area for b_area in window.b_window.screen.areas if b_area.type == "PROPERTIES")


def widen_properties(window: Window) -> Steps:
    """Drags the edge between the 3D view and the properties."""
    b_area = properties_editor(window)
    x, y = b_area.x - 1, window.b_window.height - b_area.y - b_area.height // 2
    yield from hand(
        f"mousemove {x + 20} {y}",
        f"mousemove {x} {y}",
        "mousedown 1",
        f"mousemove {x - 20} {y}",
        f"mousemove {x + b_area.width - PROPERTIES_WIDTH} {y}",
        "mouseup 1",
    )
    yield from window.rest()


def fold(*panels: str) -> Steps:
    """Clicks on headers of panels in Object properties: where each is once those before it are folded."""
    rows = {"Transform": 284, "Color": 478, "Splats": 506}
    yield from hand(*(f"mousemove 967 {rows[panel]} click 1" for panel in panels), "mousemove 500 400")


def begin(window: Window) -> Steps:
    """The factory's scene without its cube, the render engine Stipple, room for labels."""
    yield from widen_properties(window)
    b_scene = bpy.context.scene
    bpy.data.objects.remove(bpy.data.objects["Cube"])
    b_scene.render.engine = "STIPPLE"
    b_scene.stipple.device = "CPU"
    b_scene.view_settings.view_transform = "Standard"
    b_scene.world.node_tree.nodes["Background"].inputs["Color"].default_value = GRAY
    for b_object in b_scene.objects:
        b_object.hide_set(True)


def import_capture(window: Window, distance: float = 1.0) -> Any:
    """The capture, active and selected, seen from a little above."""
    bpy.ops.import_scene.splats(filepath=sys.argv[-1])
    with override(window):
        bpy.ops.view3d.view_selected()
    window.b_region_3d.view_perspective = "PERSP"
    window.b_region_3d.view_rotation = Euler((1.15, 0, 0.35)).to_quaternion()
    window.b_region_3d.view_distance *= distance
    return bpy.context.view_layer.objects.active


def first(window: Window) -> Steps:
    """A first capture: the menu, the importer, the viewport and the final picture."""
    yield from begin(window)
    yield from window.rest()
    yield from hand(
        "mousemove 42 14 click 1",
        "mousemove 80 300",
        "mousemove 80 312 click 1",
        "mousemove 330 312",
        "mousemove 330 499",
    )
    yield from window.shot("menu")
    yield from hand("key Escape", "mousemove 500 400")
    with override(window):
        bpy.ops.import_scene.splats("INVOKE_DEFAULT", filepath=sys.argv[-1])
    since = time.monotonic()
    yield lambda: time.monotonic() - since > 3.0
    yield from window.shot("importer")


def panels(window: Window) -> Steps:
    """A capture in Solid and Rendered shading, and the render panel with all its parts open."""
    yield from begin(window)
    import_capture(window, 0.95)
    properties_editor(window).spaces.active.context = "RENDER"
    window.b_space.shading.type = "RENDERED"
    yield from window.rest()
    yield from window.shot("rendered")
    yield from hand("mousemove 1000 562 click 1", "mousemove 500 400")  # Color Management
    yield from window.rest()
    yield from window.shot("sorted")
    bpy.context.scene.stipple.method = "POINTS"
    yield from window.rest()
    yield from hand("mousemove 1000 603 click 1", "mousemove 1000 575 click 1", "mousemove 500 400")  # from below up
    yield from window.rest()
    yield from window.shot("points")


def final(window: Window) -> Steps:
    """F12: the picture in Blender's own render window."""
    yield from begin(window)
    import_capture(window)
    b_scene = bpy.context.scene
    b_scene.camera.hide_set(False)
    with override(window):
        bpy.ops.view3d.camera_to_view()
        bpy.ops.view3d.camera_to_view_selected()
    window.b_region_3d.view_camera_zoom = 12.0
    window.b_space.shading.type = "RENDERED"
    properties_editor(window).spaces.active.context = "OUTPUT"
    yield from window.rest()
    yield from window.shot("camera")
    b_scene.render.filepath = "//frames/shot-"
    b_scene.render.use_overwrite, b_scene.render.use_placeholder = False, True
    yield from hand("mousemove 967 474 click 1", "mousemove 967 247 click 1", "mousemove 500 400")  # fold what is above
    yield from window.rest()
    yield from window.shot("output")
    bpy.context.preferences.view.render_display_type = "SCREEN"
    b_scene.render.resolution_percentage = 50
    with override(window):
        bpy.ops.render.render("INVOKE_DEFAULT")
    since = time.monotonic()
    yield lambda: time.monotonic() - since > 8.0
    yield from window.shot("final")


def crop(window: Window) -> Steps:
    """A capture cut by the box of an empty, whose outline shows."""
    yield from begin(window)
    b_object = import_capture(window, 1.15)
    properties_editor(window).spaces.active.context = "OBJECT"
    with override(window):
        bpy.ops.object.stipple_crop_add(shape="BOX")
    b_empty = b_object.stipple.crops[0].object
    b_empty.name = "Crop Box"
    b_empty.matrix_world = b_empty.matrix_world @ b_empty.matrix_world.Scale(0.52, 4, (1, 0, 0))
    b_empty.location.x -= 0.55
    b_empty.select_set(True)
    window.b_space.shading.type = "RENDERED"
    yield from window.rest()
    yield from fold("Transform", "Color", "Splats")
    yield from window.rest()
    yield from window.shot("crop")


def grade(window: Window) -> Steps:
    """The same view as captured and graded."""
    yield from begin(window)
    b_object = import_capture(window, 0.95)
    properties_editor(window).spaces.active.context = "OBJECT"
    window.b_space.shading.type = "RENDERED"
    window.b_space.overlay.show_outline_selected = False
    yield from window.rest()
    yield from fold("Transform")
    yield from window.rest()
    yield from window.shot("captured")
    b_stipple = b_object.stipple
    b_stipple.exposure, b_stipple.gain, b_stipple.saturation = -0.7, (0.72, 0.9, 1.35), 0.75
    yield from window.rest()
    yield from window.shot("graded")


def cube(window: Window) -> Steps:
    """The outline of a mesh cube on its copy of splats, in three kinds of view."""
    yield from begin(window)
    bpy.ops.mesh.primitive_cube_add()
    b_mesh = bpy.context.object
    b_splats = cube_of_splats()
    paint_checks(b_splats.data)
    b_splats.parent = b_mesh
    b_mesh.rotation_euler, b_mesh.scale = (0.3, 0.2, 0.4), (1.0, 0.7, 1.3)
    window.b_space.shading.type = "RENDERED"
    b_region_3d, b_camera = window.b_region_3d, bpy.context.scene.camera
    b_camera.data.shift_x, b_camera.data.shift_y = 0.1, -0.05
    b_region_3d.view_rotation = Euler((1.1, 0, 0.5)).to_quaternion()
    for kind in ("PERSP", "ORTHO", "CAMERA"):
        b_region_3d.view_perspective = kind
        b_region_3d.view_location, b_region_3d.view_distance = (0, 0, 0), 6.0
        b_region_3d.view_camera_zoom = 25.0
        yield from window.rest()
        yield from window.shot(f"cube-{kind.lower()}")


def paint_checks(b_data: Any) -> None:
    """Colors by place, in checks."""
    position = np.empty((len(b_data.points), 3), np.float32)
    b_data.attributes["position"].data.foreach_get("vector", position.ravel())
    b_attribute = b_data.attributes["radiance:base"]
    base = np.empty((len(position), 4), np.float32)
    b_attribute.data.foreach_get("vector", base.ravel())
    checks = np.floor((position * 0.999 + 1) * 2.5).sum(axis=1) % 2
    base[:, :3] = position * 0.9 + (checks[:, None] - 0.5) * 0.7
    b_attribute.data.foreach_set("vector", base.ravel())
    b_data.update_tag()


run({"first": first, "panels": panels, "final": final, "crop": crop, "grade": grade, "cube": cube})
