# SPDX-License-Identifier: GPL-3.0-or-later
"""Captures in Solid and Material Preview shading: colored points over Blender's gray ones, with bounds if selected.

Blender still draws, outlines and selects the capture itself. A draw handler of all 3D views adds the color; it returns
at once where the file has no capture. What it draws is read again only when the depsgraph says that something changed.
"""

from __future__ import annotations

import logging
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any
from weakref import WeakValueDictionary

import bpy
import numpy as np
from bpy.app.handlers import persistent

from ..engine.errors import StippleError
from . import sync
from .edit.mode import MARK
from .edit.solid import point_states, seen_flags
from .overlay_points import overlay_points
from .render_engine import ENGINE_ID
from .sequence import plays
from .splat_data import POINT_TYPES, is_capture, splat_count_of

POINTS_PER_VIEW = 1_000_000  # instances share them
BOXES_PER_VIEW = 1000
log = logging.getLogger(__package__)


@dataclass(eq=False)
class DrawnPoints:
    """A datablock's points on the graphics card."""

    b_batch: Any
    count: int
    uids: frozenset[int]  # of the datablock and objects it came from


@dataclass(frozen=True, eq=False)
class Shown:
    """All captures of one 3D view, as plain values and batches: no references to Blender's data."""

    generation: int
    visibility: tuple[object, ...]
    points: tuple[tuple[DrawnPoints, Any, bool], ...]  # with world_from_object and whether it is in front
    boxes: dict[str, Any]  # batches by the theme's color


def is_drawn_by_blender(context: Any) -> bool:
    """Whether the 3D view shows captures as gray points; in Material Preview a scene's Stipple draws them itself."""
    shading = context.space_data.shading.type
    return shading == "SOLID" or (shading == "MATERIAL" and context.scene.render.engine != ENGINE_ID)


class CaptureOverlay:
    """The draw handler and what it keeps between redraws."""

    def __init__(self) -> None:
        self._handler: Any = None
        self.free()

    def free(self) -> None:
        """Forgets everything, as after loading a file or an undo."""
        self._points: WeakValueDictionary[tuple[int, int, int, int], DrawnPoints] = WeakValueDictionary()
        self._shown: dict[int, Shown] = {}
        self._changed: set[int] = set()
        self._stale, self._generation = True, 0
        self._datablocks: tuple[int, int] | None = None  # how many there were when they were searched
        self._any = False
        self._broken: set[int] = set()

    def start(self) -> None:
        self._handler = bpy.types.SpaceView3D.draw_handler_add(self._draw_safely, (), "WINDOW", "POST_VIEW")

    def stop(self) -> None:
        if self._handler is not None:
            bpy.types.SpaceView3D.draw_handler_remove(self._handler, "WINDOW")
            self._handler = None
            from .overlay_draw import forget_shader

            forget_shader()
        self.free()

    def scene_changed(self, b_depsgraph: Any) -> None:
        """Called after each update of a depsgraph; cheap."""
        self._stale = True
        for b_update in b_depsgraph.updates:
            if b_update.is_updated_geometry:
                self._changed.add(b_update.id.original.session_uid)
                self._any = self._any or is_capture(getattr(b_update.id, "data", b_update.id))

    def _draw_safely(self) -> None:
        """A traceback in a draw handler would come back with every redraw."""
        try:
            self._draw(bpy.context)
        except Exception:
            log.exception("Captures are shown gray in this session: drawing their colors failed")
            bpy.types.SpaceView3D.draw_handler_remove(self._handler, "WINDOW")
            self._handler = None

    def _draw(self, context: Any) -> None:
        b_space, b_stipple = context.space_data, context.scene.stipple
        colours, bounds = b_stipple.show_splat_colors, b_stipple.show_splat_bounds
        bounds = bounds and b_space.overlay.show_overlays
        if not is_drawn_by_blender(context) or not (colours or bounds) or not self._has_captures():
            return
        shown = self._shown_in(context, b_space)
        if not shown.points and not shown.boxes:
            return
        from .overlay_draw import OverlayPainter  # the gpu module needs a window

        theme = context.preferences.themes[0].view_3d
        with OverlayPainter() as painter:
            total = sum(drawn.count for drawn, _, _ in shown.points)
            share = min(1.0, POINTS_PER_VIEW / max(1, total))
            for drawn, world_from_object, in_front in shown.points if colours else ():
                painter.points(drawn.b_batch, max(1, int(share * drawn.count)), world_from_object, in_front)
            for name, b_batch in shown.boxes.items() if bounds else ():
                painter.lines(b_batch, tuple(getattr(theme, name)))

    def _has_captures(self) -> bool:
        """Whether a datablock of the file is a capture, searched again only when their number changes."""
        count = (len(bpy.data.pointclouds), len(bpy.data.meshes))
        if count != self._datablocks:
            self._datablocks = count
            self._any = any(is_capture(b_data) for group in (bpy.data.pointclouds, bpy.data.meshes) for b_data in group)
        return self._any

    def _shown_in(self, context: Any, b_space: Any) -> Shown:
        if self._stale:
            self._next_generation()
        place = b_space.as_pointer()
        shown, visibility = self._shown.get(place), sync.visibility_of(b_space)
        if shown is None or shown.generation != self._generation or shown.visibility != visibility:
            self._shown[place] = shown = self._read(context, b_space, visibility)
        return shown

    def _next_generation(self) -> None:
        self._stale, self._generation = False, self._generation + 1
        changed, self._changed = self._changed, set()
        for key in [key for key, drawn in self._points.items() if drawn.uids & changed]:
            del self._points[key]
        self._broken -= changed
        # A view that was not drawn for two generations is gone or hidden.
        recent = self._generation - 1
        self._shown = {key: shown for key, shown in self._shown.items() if shown.generation >= recent}

    def _read(self, context: Any, b_space: Any, visibility: tuple[object, ...]) -> Shown:
        points: list[tuple[DrawnPoints, Any, bool]] = []
        boxes: dict[str, list[Any]] = {}
        for b_instance, b_object in _captures(context.evaluated_depsgraph_get(), b_space):
            world_from_object = b_instance.matrix_world.copy()
            drawn = self._points_of(b_instance, b_object, context.scene.stipple_edit.show_highlight)
            if drawn is not None and b_object.display_type in ("SOLID", "TEXTURED"):
                points.append((drawn, world_from_object, b_object.show_in_front))
            colour_name = _outline_colour(context, b_instance, b_object)
            if colour_name and not b_object.show_bounds:
                corners = np.array(b_object.bound_box) @ np.array(world_from_object)[:3, :3].T
                boxes.setdefault(colour_name, []).append(corners + np.array(world_from_object.translation))
        from .overlay_draw import lines_batch

        batches = {name: lines_batch(np.array(several[:BOXES_PER_VIEW])) for name, several in boxes.items()}
        return Shown(self._generation, visibility, tuple(points), batches)

    def _points_of(self, b_instance: Any, b_object: Any, show_highlight: bool) -> DrawnPoints | None:
        b_data = b_object.data
        b_original = b_object.original  # whose data it is: before Blender 5, evaluated data forgets its original
        b_shown = b_instance.parent.original if b_instance.is_instance else b_original
        uids = frozenset(b_id.session_uid for b_id in (b_original.data, b_original, b_shown))
        seen = seen_flags(getattr(b_original, MARK), show_highlight)
        key = (b_data.as_pointer(), b_original.data.session_uid, splat_count_of(b_data), seen)
        drawn = self._points.get(key)
        if drawn is not None or uids & self._broken:
            return drawn
        from .overlay_draw import points_batch

        try:
            states = None if plays(b_object) else point_states(b_data)
            points = overlay_points(b_data, b_object.name, states=None if states is None else states & np.uint32(seen))
        except StippleError as error:
            log.warning("%s", error)
            self._broken |= uids
            return None
        if not len(points.place):
            return None
        self._points[key] = drawn = DrawnPoints(points_batch(points), len(points.place), uids)
        return drawn


def _captures(b_depsgraph: Any, b_space: Any) -> Iterator[tuple[Any, Any]]:
    """What the 3D view shows of captures; in Edit Mode Blender's own points say more."""
    for b_instance in b_depsgraph.object_instances:
        b_object = b_instance.object
        if not b_instance.show_self or b_object.type not in POINT_TYPES or b_object.mode != "OBJECT":
            continue
        if not is_capture(b_object.data) or not splat_count_of(b_object.data):
            continue
        if (b_instance.parent if b_instance.is_instance else b_object).visible_in_viewport_get(b_space):
            yield b_instance, b_object


def _outline_colour(context: Any, b_instance: Any, b_object: Any) -> str:
    """The name of the theme's color for the object's outline; "" for one that is not selected."""
    b_original = (b_instance.parent if b_instance.is_instance else b_object).original
    if not b_original.select_get(view_layer=context.view_layer):
        return ""
    return "object_active" if b_original == context.view_layer.objects.active else "object_selected"


overlay = CaptureOverlay()


@persistent
def _after_update(_b_scene: Any, b_depsgraph: Any) -> None:
    overlay.scene_changed(b_depsgraph)


@persistent
def _forget(*_: object) -> None:
    overlay.free()


def _handlers() -> tuple[tuple[list[Any], Any], ...]:
    handlers = bpy.app.handlers
    return (
        (handlers.depsgraph_update_post, _after_update),
        (handlers.frame_change_post, _after_update),
        *(
            (group, _forget)
            for group in (handlers.load_pre, handlers.load_post, handlers.undo_post, handlers.redo_post)
        ),
    )


def register() -> None:
    if bpy.app.background:
        return  # nothing draws there
    for group, handler in _handlers():
        group.append(handler)
    overlay.start()


def unregister() -> None:
    if bpy.app.background:
        return
    for group, handler in _handlers():
        group.remove(handler)
    overlay.stop()
