# SPDX-License-Identifier: GPL-3.0-or-later
"""Brush strokes over the viewport: every dab shows at once on the session, the datablock is written once at the end."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np

from ..view_camera import view_of
from .kernels import check_ready
from .mode import Reported, edited_object
from .operator import device_of, redraw, session_in
from .overlay import Overlay, draw_circle
from .preview import end_preview, show_preview
from .session import EditSession

if TYPE_CHECKING:
    from ...engine.edit.step import Step

SPACING = 0.3  # of the radius, between dabs
MOST_DABS = 12  # per movement, or a slow machine falls ever farther behind


class StrokeOperator:
    """Adds `invoke` and `modal`. Subclasses begin, dab, finish and cancel the engine's stroke; pixels from bottom left.

    `stays` keeps the operator going after a stroke, until Escape: Blender's circle select does.
    """

    stays = False
    hint = "Paint: LMB    Cancel: RMB, Esc"

    def begin(self, context: Any, session: EditSession, event: Any) -> None:
        raise NotImplementedError

    def dab(self, context: Any, session: EditSession, x: float, y: float) -> None:
        raise NotImplementedError

    def finish(self, session: EditSession) -> Step | None:
        """The whole stroke as a step whose changes are made."""
        raise NotImplementedError

    def cancel_stroke(self, session: EditSession) -> None:
        raise NotImplementedError

    def sources_of(self, step: Step) -> np.ndarray | None:
        """As `EditSession.commit` takes it, of strokes that append splats."""
        return None

    def brush_radius(self, context: Any) -> float:
        return float(context.scene.stipple_edit.radius)

    def invoke(self, context: Any, event: Any) -> set[str]:
        if context.region is None or context.region_data is None:
            return self.execute(context)  # type: ignore[attr-defined]
        with Reported(self):
            check_ready(device_of(context))
            self._session, self._down, self._changed = session_in(context, by_hand=True), False, False
            self._mouse = self._last = np.array([event.mouse_region_x, event.mouse_region_y], float)
            self.engine_camera = view_of(context, context.scene).camera()
            self.begin(context, self._session, event)
            self._overlay = Overlay(context, lambda: draw_circle(tuple(self._mouse), self.brush_radius(context)))
            context.workspace.status_text_set(self.hint)
            if event.type == "LEFTMOUSE" and event.value != "RELEASE" and not self.stays:
                self._down = True
                try:
                    self._dab_to(context, self._mouse, first=True)
                except BaseException:
                    self._end(context, cancelled=True)
                    raise
            # Last: Blender crashes where an operator has a handler and does not go on.
            context.window_manager.modal_handler_add(self)
            return {"RUNNING_MODAL"}
        return {"CANCELLED"}

    def modal(self, context: Any, event: Any) -> set[str]:
        ended: set[str] | None = None
        with Reported(self):
            ended = self._event(context, event)
            if ended is None:
                return {"RUNNING_MODAL"}
        return self._end(context, cancelled=ended is None or "CANCELLED" in ended)

    def _event(self, context: Any, event: Any) -> set[str] | None:
        """What ends the stroke; None while it goes on."""
        context.area.tag_redraw()
        if event.type in {"ESC", "RIGHTMOUSE"}:
            return {"FINISHED"} if self.stays and self._changed and event.type == "RIGHTMOUSE" else {"CANCELLED"}
        if event.type in {"RET", "NUMPAD_ENTER"}:
            return {"FINISHED"}
        if event.type == "LEFTMOUSE":
            self._down = event.value == "PRESS"
            if not self._down:
                return None if self.stays else {"FINISHED"}
            self.pressed(event)
            self._dab_to(context, np.array([event.mouse_region_x, event.mouse_region_y], float), first=True)
        elif event.type == "MOUSEMOVE":
            self._mouse = np.array([event.mouse_region_x, event.mouse_region_y], float)
            if self._down:
                self._dab_to(context, self._mouse)
        elif self.stays and event.type in {"WHEELUPMOUSE", "WHEELDOWNMOUSE", "NUMPAD_PLUS", "NUMPAD_MINUS"}:
            grows = event.type in {"WHEELDOWNMOUSE", "NUMPAD_PLUS"}
            context.scene.stipple_edit.radius = max(1, int(self.brush_radius(context) * (1.15 if grows else 0.87)))
        return None

    def pressed(self, event: Any) -> None:
        """The button went down again, with its modifiers."""

    def _dab_to(self, context: Any, place: np.ndarray, first: bool = False) -> None:
        for x, y in [tuple(place)] if first else self._places(place, self.brush_radius(context) * SPACING):
            self.dab(context, self._session, x, y)
        self._last = place if first else self._last
        self._changed = True
        show_preview(edited_object(context).data, self._session)
        redraw(context)

    def _places(self, place: np.ndarray, spacing: float) -> Iterator[tuple[float, float]]:
        """Where dabs go on the way to the mouse."""
        way = place - self._last
        length = float(np.linalg.norm(way))
        count = int(length / max(spacing, 1.0))
        step = way / length * max(spacing, 1.0) * max(1.0, count / MOST_DABS) if count else way
        for _ in range(min(count, MOST_DABS)):
            self._last = self._last + step
            yield float(self._last[0]), float(self._last[1])

    def _end(self, context: Any, cancelled: bool) -> set[str]:
        b_data, done = edited_object(context).data, False
        with Reported(self):
            try:
                if cancelled:
                    self.cancel_stroke(self._session)
                else:
                    step = self.finish(self._session)
                    done = step is not None and self._session.commit(b_data, step, self.sources_of(step), done=True)
            finally:
                self._overlay.end()
                end_preview(b_data)
                context.workspace.status_text_set(None)
                redraw(context)
        return {"FINISHED"} if done else {"CANCELLED"}
