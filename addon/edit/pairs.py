# SPDX-License-Identifier: GPL-3.0-or-later
"""Three pairs of points picked in the viewport: one on the active capture, then where it belongs on another, thrice."""

from __future__ import annotations

from typing import Any

import numpy as np

from ...engine.errors import StippleError
from .. import residency, sync
from ..view_camera import view_of
from .kernels import check_ready
from .mode import Reported
from .operator import device_of
from .overlay import Overlay, draw_circle, draw_lines
from .visible import Picker

PAIRS = 3


class PairsOperator:
    """`invoke` and `modal` for an operator with `source_1` … `target_3` and `execute`."""

    def invoke(self, context: Any, event: Any) -> set[str]:
        if context.region is None or context.region_data is None:
            return self.execute(context)  # type: ignore[attr-defined]
        with Reported(self):
            check_ready(device_of(context))
            scene, _ = sync.scene_from_depsgraph(context.evaluated_depsgraph_get(), residency.clouds)
            own = tuple(one for one in scene.instances if one.name == context.object.name)
            others = tuple(one for one in scene.instances if one.name != context.object.name)
            if not own or not others:
                raise StippleError("Align: show the active capture and another one to align it with.")
            self._instances = (own, others)
            self._points: list[np.ndarray] = []
            self._overlay = Overlay(context, lambda: self._draw(context))
            context.window.cursor_modal_set("CROSSHAIR")
            self._say(context)
            context.window_manager.modal_handler_add(self)
            return {"RUNNING_MODAL"}
        return {"CANCELLED"}

    def modal(self, context: Any, event: Any) -> set[str]:
        if event.type in {"ESC", "RIGHTMOUSE"}:
            return self._end(context, {"CANCELLED"})
        if event.value == "PRESS" and event.type in {"BACK_SPACE", "Z"} and self._points:
            self._points.pop()
        elif event.type == "LEFTMOUSE" and event.value == "PRESS":
            with Reported(self):
                self._click(context, event)
        elif event.type != "MOUSEMOVE":
            return {"PASS_THROUGH"}  # the view may be turned between clicks
        self._say(context)
        context.area.tag_redraw()
        if len(self._points) < 2 * PAIRS:
            return {"RUNNING_MODAL"}
        self._end(context, set())
        for number in range(PAIRS):
            setattr(self, f"source_{number + 1}", self._points[2 * number])
            setattr(self, f"target_{number + 1}", self._points[2 * number + 1])
        return self.execute(context)  # type: ignore[attr-defined]

    def _click(self, context: Any, event: Any) -> None:
        instances = self._instances[len(self._points) % 2]
        picker = Picker(context, instances, view_of(context, context.scene).camera())
        found = picker.pick(event.mouse_region_x, event.mouse_region_y)
        if found is None:
            which = "the active capture" if len(self._points) % 2 == 0 else "another capture"
            raise StippleError(f"Align: {which} is not under the cursor.")
        self._points.append(found.position_world)

    def _draw(self, context: Any) -> None:
        from bpy_extras.view3d_utils import location_3d_to_region_2d

        seen = [location_3d_to_region_2d(context.region, context.region_data, tuple(point)) for point in self._points]
        places = [None if place is None else (place.x, place.y) for place in seen]
        for place in places:
            if place is not None:
                draw_circle(place, 6)
        for begin, end in zip(places[::2], places[1::2], strict=False):
            if begin is not None and end is not None:
                draw_lines([begin, end], closed=False)

    def _say(self, context: Any) -> None:
        number, on_other = divmod(len(self._points), 2)
        where = "where it belongs on another capture" if on_other else "a point of the active capture"
        context.workspace.status_text_set(
            f"Pair {number + 1} of {PAIRS}: click {where}    Take back: Backspace    Cancel: RMB, Esc"
        )

    def _end(self, context: Any, result: set[str]) -> set[str]:
        self._overlay.end()
        context.window.cursor_modal_restore()
        context.workspace.status_text_set(None)
        context.area.tag_redraw()
        return result
