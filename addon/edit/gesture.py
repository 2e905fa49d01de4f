# SPDX-License-Identifier: GPL-3.0-or-later
"""Rectangles and lassos drawn over the viewport: `invoke` and `modal` for operators that take them as properties."""

from __future__ import annotations

from typing import Any, ClassVar

from bpy.props import BoolProperty

from .kernels import check_ready
from .mode import Reported
from .operator import device_of, session_in
from .overlay import Overlay, draw_lines


class GestureOperator:
    """From the button's press to its release; with `wait_for_input` it waits for the press first.

    Shift at the press extends the selection and Ctrl takes away. Subclasses have `set_path(points)`, `mode` and
    `execute`.
    """

    wait_for_input: BoolProperty(  # type: ignore[valid-type]
        name="Wait for Input", default=True, options={"HIDDEN", "SKIP_SAVE"}
    )
    freehand: ClassVar[bool]

    def set_path(self, points: list[tuple[float, float]]) -> None:
        raise NotImplementedError

    def invoke(self, context: Any, event: Any) -> set[str]:
        if context.region is None or context.region_data is None:
            return self.execute(context)  # type: ignore[attr-defined]
        with Reported(self):
            check_ready(device_of(context))
            self.by_hand = True
            session_in(context, self.by_hand)  # says now what is wrong, and makes ready
            self._points = [] if self.wait_for_input else [_place(event)]
            self._overlay = Overlay(context, lambda: draw_lines(self._corners()))
            context.window.cursor_modal_set("CROSSHAIR")
            context.workspace.status_text_set("Drag: LMB    Extend: Shift    Subtract: Ctrl    Cancel: RMB, Esc")
            context.window_manager.modal_handler_add(self)
            return {"RUNNING_MODAL"}
        return {"CANCELLED"}

    def modal(self, context: Any, event: Any) -> set[str]:
        context.area.tag_redraw()
        if event.type in {"ESC", "RIGHTMOUSE"}:
            return self._end(context, {"CANCELLED"})
        if event.type == "LEFTMOUSE" and event.value == "PRESS":
            self._points = [_place(event)]
            if event.shift or event.ctrl:
                self.mode = "SUB" if event.ctrl else "ADD"
        elif self._points and event.type in {"MOUSEMOVE", "INBETWEEN_MOUSEMOVE"}:
            self._points = [*self._points, _place(event)] if self.freehand else [self._points[0], _place(event)]
        elif self._points and event.type == "LEFTMOUSE" and event.value == "RELEASE":
            self._end(context, set())
            self.set_path([*self._points, _place(event)] if self.freehand else [self._points[0], _place(event)])
            return self.execute(context)  # type: ignore[attr-defined]
        return {"RUNNING_MODAL"}

    def _corners(self) -> list[tuple[float, float]]:
        if self.freehand or len(self._points) < 2:
            return self._points
        (left, bottom), (right, top) = self._points
        return [(left, bottom), (right, bottom), (right, top), (left, top)]

    def _end(self, context: Any, result: set[str]) -> set[str]:
        self._overlay.end()
        context.window.cursor_modal_restore()
        context.workspace.status_text_set(None)
        return result


def _place(event: Any) -> tuple[float, float]:
    return event.mouse_region_x, event.mouse_region_y
