# SPDX-License-Identifier: GPL-3.0-or-later
"""What the tests do in Blender's window; `window` says how to run it."""

from __future__ import annotations

import math
import sys
from pathlib import Path
from typing import Any

import bpy
import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parent))
from window import Steps, Window, cube_of_splats, run, use_stipple


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


def borders(window: Window) -> Steps:
    """A camera view with lens shift and a perspective view, each whole and with a render region of its own."""
    from bpy_extras.view3d_utils import location_3d_to_region_2d

    b_render = use_stipple().render
    window.bare()
    b_mesh = bpy.data.objects["Cube"]
    cube_of_splats().parent = b_mesh
    b_mesh.hide_set(True)
    window.b_space.shading.type = "RENDERED"
    for kind, b_border, prefix in (("CAMERA", b_render, ""), ("PERSP", window.b_space, "render_")):
        look(window, kind, b_mesh)
        yield from window.rest()
        yield from window.shot(f"{kind}-whole")
        for name, value in (("min_x", 0.3), ("max_x", 0.55), ("min_y", 0.35), ("max_y", 0.6)):
            setattr(b_border, f"{prefix}border_{name}", value)
        setattr(b_border, f"use_{prefix}border", True)
        yield from window.rest()
        yield from window.shot(f"{kind}-border")
        setattr(b_border, f"use_{prefix}border", False)
    b_scene = bpy.context.scene
    look(window, "CAMERA", b_mesh)
    yield from window.rest()
    corners = [b_scene.camera.matrix_world @ corner for corner in b_scene.camera.data.view_frame(scene=b_scene)]
    places = [location_3d_to_region_2d(window.b_region, window.b_region_3d, corner) for corner in corners]
    window.results["frame"] = [min(p.x for p in places), min(p.y for p in places)]
    window.results["frame"] += [max(p.x for p in places), max(p.y for p in places)]


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


SCENARIOS = {"alignment": alignment, "borders": borders, "final_render": final_render, "moving": moving}

run(SCENARIOS)
