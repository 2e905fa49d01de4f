# SPDX-License-Identifier: GPL-3.0-or-later
"""Circle select as a stroke: C as everywhere, or the tool's drag."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from bpy.props import BoolProperty

from ...engine.camera import Camera
from ...engine.look import Look
from .operator import world_from_object
from .screen import camera_of, from_top, look_in
from .session import EditSession
from .stroke import StrokeOperator

if TYPE_CHECKING:
    from ...engine.edit.mask import Mask
    from ...engine.edit.step import Step

TAKEN_AWAY = 1.0  # `time` of a place in `path` that deselects


class CircleStroke(StrokeOperator):
    """Circles of one radius along the mouse; with `wait_for_input` it goes on until Enter or the right button.

    The operator has `path`, `radius`, `border`, `mode`, `camera` and `visible_only`.
    """

    wait_for_input: BoolProperty(default=True, options={"HIDDEN", "SKIP_SAVE"})  # type: ignore[valid-type]
    hint = "Select: LMB    Deselect: Shift-LMB    Size: Wheel    Confirm: RMB, Enter    Cancel: Esc"
    if TYPE_CHECKING:  # Blender must not see these
        path: Any
        radius: Any
        border: Any
        mode: Any
        camera: Any
        visible_only: Any

    @property
    def stays(self) -> bool:  # type: ignore[override]
        return bool(self.wait_for_input)

    def begin(self, context: Any, session: EditSession, event: Any) -> None:
        self.path.clear()
        self._take = self.mode == "SUB"
        self._before, self._look = session.cloud.selection(), look_in(context)
        self._visible = self._seen(context, session, self.engine_camera)
        if self.mode == "SET":
            if self.wait_for_input:
                self.mode = "ADD"
            else:
                self._put(session, self._before ^ self._before)

    def pressed(self, event: Any) -> None:
        self._take = event.shift if self.wait_for_input else self.mode == "SUB"

    def dab(self, context: Any, session: EditSession, x: float, y: float) -> None:
        self.radius = int(self.brush_radius(context))
        b_place = self.path.add()
        b_place.loc, b_place.time = (x, y), TAKEN_AWAY * self._take
        placed = world_from_object(context)
        found = self.circle_at(session, self.engine_camera, placed, self._look, (x, y))
        self._put(session, self._combined(session.cloud.selection(), found, self._take))

    def circle_at(
        self, session: EditSession, camera: Camera, placed: np.ndarray, look: Look, place: tuple[float, float]
    ) -> Mask:
        from ...engine.edit.match_screen import match_circle

        return match_circle(session.cloud, camera, from_top(camera, place), self.radius, self.border, placed, look)

    def stroke_step(self, context: Any, session: EditSession) -> Step:
        """All of `path` at once."""
        from ...engine.edit.selection import select

        camera, placed, look = camera_of(context, self.camera), world_from_object(context), look_in(context)
        self._visible = self._seen(context, session, camera)
        chosen = session.cloud.selection()
        if self.mode == "SET":
            chosen = chosen ^ chosen
        for b_place in self.path:
            found = self.circle_at(session, camera, placed, look, tuple(b_place.loc))
            take = b_place.time == TAKEN_AWAY or self.mode == "SUB"
            chosen = self._combined(chosen, found, take)
        return select(session.cloud, chosen)

    def finish(self, session: EditSession) -> Step:
        from ...engine.edit.state_bits import SELECTED
        from ...engine.edit.step import flag_step

        return flag_step("Circle Select", SELECTED, self._before ^ session.cloud.selection())

    def cancel_stroke(self, session: EditSession) -> None:
        self.finish(session).revert(session.cloud)

    def _seen(self, context: Any, session: EditSession, camera: Camera) -> Mask | None:
        if not self.visible_only:
            return None
        from .visible import visible_mask

        return visible_mask(context, session, camera)

    def _combined(self, chosen: Mask, found: Mask, take: bool) -> Mask:
        found = found if self._visible is None else found & self._visible
        return chosen - found if take else chosen | found

    @staticmethod
    def _put(session: EditSession, chosen: Mask) -> None:
        from ...engine.edit.selection import select

        select(session.cloud, chosen).apply(session.cloud)
