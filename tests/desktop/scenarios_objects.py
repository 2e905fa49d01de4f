# SPDX-License-Identifier: GPL-3.0-or-later
"""What the tests do in Blender's window with the settings of one object."""

from __future__ import annotations

import sys
from importlib import import_module
from pathlib import Path
from typing import Any

import bpy

sys.path.insert(0, str(Path(__file__).resolve().parent))
from window import PACKAGE, Steps, Window, cube_of_splats, run, use_stipple


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


run({"objects": objects})
