# SPDX-License-Identifier: GPL-3.0-or-later
"""What the tests do in Blender's window with edits, several views, first use and Solid shading."""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Any

import bpy

sys.path.insert(0, str(Path(__file__).resolve().parent))
from window import PACKAGE, TICK, Steps, Window, cube_of_splats, run, use_stipple

BLUE = (0.05, 0.05, 0.8, 1)


def residency() -> Any:
    return import_module(f"{PACKAGE}.addon.residency")


def override(window: Window, **more: Any) -> Any:
    return bpy.context.temp_override(window=window.b_window, area=window.b_area, region=window.b_region, **more)


def wait(seconds: float) -> Callable[[], bool]:
    end = time.monotonic() + seconds
    return lambda: time.monotonic() > end


def red_world_cube(window: Window) -> Any:
    """A cube of red splats, alone in a blue world, in Rendered shading."""
    use_stipple()
    for b_object in list(bpy.data.objects):
        bpy.data.objects.remove(b_object)
    bpy.context.scene.world.node_tree.nodes["Background"].inputs["Color"].default_value = BLUE
    window.bare()
    b_splats = cube_of_splats()
    bpy.context.view_layer.objects.active = b_splats
    window.b_space.shading.type = "RENDERED"
    return b_splats


def first_use(window: Window) -> Steps:
    """The very first picture of a computer: what the text says meanwhile, and how long the interface stood still."""
    red_world_cube(window)
    messages: dict[str, None] = {}
    gaps, last = [], time.monotonic()
    window.b_area.tag_redraw()
    yield lambda: bool(residency().worker._sessions)
    session = window.session

    def shown() -> bool:
        nonlocal last
        now = time.monotonic()
        gaps.append(now - last)
        last = now
        messages[session.status()] = None
        return session.picture is not None

    begin = last = time.monotonic()
    yield shown
    window.results.update(messages=list(messages), longest_gap=max(gaps), seconds=time.monotonic() - begin)


def edits(window: Window) -> Steps:
    """After each edit: the cube's red pixels and splats that the viewport drew, and how many captures it read."""
    b_splats = red_world_cube(window)
    b_empty = bpy.data.objects.new("Empty", None)
    bpy.context.scene.collection.objects.link(b_empty)
    yield from window.rest()
    bpy.ops.ed.undo_push(message="start")
    clouds = residency().clouds
    cloud_of, reads = clouds.cloud_of, [0]

    def counted(*arguments: Any) -> Any:
        reads[0] += 1
        return cloud_of(*arguments)

    clouds.cloud_of = counted

    def note(name: str) -> Steps:
        yield from window.rest()
        rgba = window.session.picture.rgba
        window.results[name] = [float((rgba[..., 0] > 0.4).sum()), window.session.picture.splats_visible, reads[0]]
        reads[0] = 0

    yield from note("start")
    b_splats.location.x = 1.0
    yield from note("moved")
    b_splats.scale = (0.5, 0.5, 0.5)
    yield from note("scaled")
    bpy.ops.ed.undo_push(message="scaled")
    with override(window):
        bpy.ops.ed.undo()
    yield from note("undone")
    yield from visibility(window, note)
    yield from frames_and_data(note)


def visibility(window: Window, note: Callable[[str], Steps]) -> Steps:
    b_splats, b_empty = bpy.data.objects["Splats"], bpy.data.objects["Empty"]
    b_splats.hide_set(True)
    yield from note("hidden")
    b_splats.hide_set(False)
    yield from note("shown")
    with override(window):
        bpy.ops.object.select_all(action="DESELECT")
        b_empty.select_set(True)
        bpy.ops.view3d.localview()
    yield from note("local view of another")
    with override(window):
        bpy.ops.view3d.localview()
    yield from note("local view left")
    window.b_space.show_object_viewport_pointcloud = False
    yield from note("type hidden")
    window.b_space.show_object_viewport_pointcloud = True
    yield from note("type shown")


def frames_and_data(note: Callable[[str], Steps]) -> Steps:
    b_splats = bpy.data.objects["Splats"]
    b_splats.keyframe_insert("location", frame=1)
    b_splats.location.x = 30.0
    b_splats.keyframe_insert("location", frame=2)
    bpy.context.scene.frame_set(2)
    yield from note("frame 2")
    bpy.context.scene.frame_set(1)
    yield from note("frame 1")
    b_splats.data.attributes["position"].data.foreach_set("vector", [0.0] * (3 * len(b_splats.data.points)))
    b_splats.data.update_tag()
    yield from note("edited")


def views(window: Window) -> Steps:
    """Two viewports, then sizes that change while nothing can be rendered, then rest."""
    red_world_cube(window)
    yield from window.rest()
    with override(window):
        bpy.ops.screen.area_split(direction="VERTICAL", factor=0.5)
    b_areas = [b_area for b_area in window.b_window.screen.areas if b_area.type == "VIEW_3D"]
    sessions = residency().worker._sessions
    for b_area in b_areas:
        b_area.spaces.active.shading.type = "RENDERED"  # which Blender does not copy
    yield lambda: len(sessions) == 2 and all(s.due() is None and s.picture is not None for s in sessions)
    yield wait(0.5)
    for index, b_area in enumerate(b_areas):
        window.b_area, window.b_region = b_area, next(r for r in b_area.regions if r.type == "WINDOW")
        yield from window.shot(f"view {index}")
    with residency().worker.final_render(lambda: None):  # viewports stand still
        with override(window):
            bpy.ops.screen.screen_full_area()
        yield wait(1.0)
        window.b_area = next(b_area for b_area in window.b_window.screen.areas if b_area.type == "VIEW_3D")
        window.b_region = next(r for r in window.b_area.regions if r.type == "WINDOW")
        window.results["pictures while full"] = sum(session.picture is not None for session in sessions)
        yield from window.shot("full")
    with override(window):
        bpy.ops.screen.back_to_previous()
    yield wait(1.0)
    yield lambda: len(sessions) == 2 and all(s.due() is None and s.picture is not None for s in sessions)
    yield wait(1.0)
    window.b_area = b_areas[0]
    window.b_region = next(r for r in window.b_area.regions if r.type == "WINDOW")
    yield from window.shot("back")
    yield from idle(window)


def idle(window: Window) -> Steps:
    """Cores that Blender uses for three seconds while all viewports are at their limit, and their redraws."""
    viewport_class = import_module(f"{PACKAGE}.addon.viewport_draw").Viewport
    draw, redraws = viewport_class.draw, [0]

    def counted(*arguments: Any) -> None:
        redraws[0] += 1
        draw(*arguments)

    viewport_class.draw = counted
    begin = time.process_time()
    yield wait(3.0)
    window.results["idle"] = {"cores": (time.process_time() - begin) / 3.0, "redraws": redraws[0]}
    viewport_class.draw = draw


def solid(window: Window) -> Steps:
    """A capture in Solid shading: coloured, hidden, in front, behind, as a mesh, framed, and clicked at."""
    b_splats = red_world_cube(window)
    b_scene, b_region_3d = bpy.context.scene, window.b_region_3d
    b_region_3d.view_perspective, b_region_3d.view_location, b_region_3d.view_distance = "PERSP", (0, 0, 0), 7.0
    window.b_space.shading.type = "SOLID"

    def shot(name: str) -> Steps:
        yield from window.rest()
        yield from window.shot(name)

    yield from shot("colours")
    b_scene.stipple.show_splat_colors = False
    yield from shot("gray")
    b_scene.stipple.show_splat_colors = True
    b_splats.hide_set(True)
    yield from shot("hidden")
    b_splats.hide_set(False)
    bpy.ops.mesh.primitive_cube_add(size=2.5)
    b_around = bpy.context.object
    b_around.select_set(False)
    yield from shot("inside a cube")
    b_splats.show_in_front = True
    yield from shot("in front")
    b_splats.show_in_front = False
    bpy.data.objects.remove(b_around)
    yield from twice(window, b_splats)
    yield from clicks(window, b_splats)
    b_region_3d.view_location, b_region_3d.view_distance = (50, 0, 0), 30.0
    with override(window):
        bpy.ops.view3d.view_selected()
    yield wait(1.0)
    window.results["framed"] = [*b_region_3d.view_location, b_region_3d.view_distance]
    yield from shot("selected")


def twice(window: Window, b_splats: Any) -> Steps:
    """The same datablock in two objects."""
    b_copy = b_splats.copy()
    bpy.context.scene.collection.objects.link(b_copy)
    b_copy.location, b_copy.scale = (0, 2.5, 0), (0.5, 0.5, 0.5)
    yield from window.rest()
    yield from window.shot("twice")
    bpy.data.objects.remove(b_copy)


def clicks(window: Window, b_splats: Any) -> Steps:
    """Selects a capture in the middle of the view with the mouse: as a mesh, then as it is."""
    b_mesh = as_mesh(b_splats)
    yield from window.rest()
    yield from window.shot("mesh")
    window.b_space.overlay.show_overlays = True  # where Blender draws, and selects, loose vertices
    yield from window.rest()
    subprocess.run(["xdotool", "mousemove", *centre_of(window), "click", "1"], check=True)
    yield wait(1.0)
    window.results["clicked"] = [b_mesh.select_get(), b_splats.select_get()]
    bpy.data.objects.remove(b_mesh)
    b_splats.hide_set(False)
    subprocess.run(["xdotool", "click", "1"], check=True)
    yield wait(1.0)
    window.results["clicked again"] = b_splats.select_get()


def as_mesh(b_splats: Any) -> Any:
    """A capture as Blender 4.5 holds one, in place of a point cloud."""
    data = import_module(f"{PACKAGE}.addon.splat_data")
    cloud, _ = data.cloud_from_datablock(b_splats.data, "mesh")
    b_data = bpy.data.meshes.new("Mesh")
    b_data.vertices.add(cloud.splat_count)
    data.write_cloud(b_data, cloud)
    b_mesh = bpy.data.objects.new("Mesh", b_data)
    bpy.context.scene.collection.objects.link(b_mesh)
    b_splats.hide_set(True)
    return b_mesh


def centre_of(window: Window) -> tuple[str, str]:
    """The 3D view's centre [px of the screen, rows from the top]."""
    b_region = window.b_region
    x, y = b_region.x + b_region.width // 2, b_region.y + b_region.height // 2
    return str(x), str(window.b_window.height - y)


SCENARIOS = {"first_use": first_use, "edits": edits, "views": views, "solid": solid}
assert TICK < 0.1  # the interface's gaps are measured with it

run(SCENARIOS)
