# SPDX-License-Identifier: GPL-3.0-or-later
"""G, R and S as in Blender: the mouse, X, Y, Z for an axis or with Shift its plane, typed numbers, Ctrl to snap.

The splats follow on the session alone; the datablock is written once, when the button is released.
"""

from __future__ import annotations

import math
from typing import Any, ClassVar

import numpy as np

from ...engine.errors import StippleError
from ..view_camera import view_of
from .kernels import check_ready
from .mode import Reported, edited_object
from .operator import device_of, redraw, session_in, world_from_object
from .preview import end_preview, show_preview

DIGITS = {
    name: str(value)
    for value, name in enumerate(["ZERO", "ONE", "TWO", "THREE", "FOUR", "FIVE", "SIX", "SEVEN", "EIGHT", "NINE"])
}
DIGITS |= {f"NUMPAD_{value}": str(value) for value in range(10)} | {"PERIOD": ".", "NUMPAD_PERIOD": "."}
SNAP = {"translate": 0.1, "rotate": math.radians(5), "resize": 0.1}
PRECISE = 0.1


class DragOperator:
    """Adds `invoke` and `modal` to a transform with `value`, `kind`, `matrix` and `pivot_of`."""

    kind: ClassVar[str]

    def invoke(self, context: Any, event: Any) -> set[str]:
        if context.region is None or context.region_data is None:
            return self.execute(context)  # type: ignore[attr-defined]
        with Reported(self):
            from ...engine.edit.transform import TransformDrag

            check_ready(device_of(context))
            self._session = session_in(context, by_hand=True)
            self._pivot = self.pivot_of(context, self._session)  # type: ignore[attr-defined]
            self._camera = view_of(context, context.scene).camera()
            self._drag = TransformDrag(self._session.cloud, world_from_object(context), self.bl_label)  # type: ignore[attr-defined]
            self._begin = self._mouse = np.array([event.mouse_region_x, event.mouse_region_y], float)
            self._axes, self._plane, self._typed, self._precise = "", False, "", None
            self._angle = 0.0
            self._refusal: StippleError | None = None
            self._say(context)
            context.window_manager.modal_handler_add(self)
            return {"RUNNING_MODAL"}
        return {"CANCELLED"}

    def modal(self, context: Any, event: Any) -> set[str]:
        if event.type in {"ESC", "RIGHTMOUSE"} and event.value == "PRESS":
            return self._end(context, cancelled=True)
        if event.type in {"LEFTMOUSE", "RET", "NUMPAD_ENTER"} and event.value in {"PRESS", "RELEASE"}:
            return self._end(context, cancelled=False)
        if event.type == "MOUSEMOVE":
            self._move(np.array([event.mouse_region_x, event.mouse_region_y], float))
        elif event.value == "PRESS":
            self._key(event)
        elif event.type not in {"LEFT_CTRL", "RIGHT_CTRL"}:
            return {"PASS_THROUGH"} if event.type.startswith("NDOF") else {"RUNNING_MODAL"}
        with Reported(self):
            self._set_value(context, event.ctrl, event.shift and not self._plane)
            self._show(context, self.matrix(self._pivot))  # type: ignore[attr-defined]
            self._say(context)
            return {"RUNNING_MODAL"}
        return self._end(context, cancelled=True)

    def _show(self, context: Any, matrix: np.ndarray) -> None:
        """Lets the splats follow; where no splats can, the last map stays, for 0 is on the way to 0.5."""
        from ...engine.edit.affine import checked

        try:
            checked(matrix, f"{self._session.name}: the transform")
        except StippleError as refusal:
            self._refusal = refusal  # of what is confirmed
            return
        self._refusal = None
        self._drag.update(matrix)
        show_preview(edited_object(context).data, self._session, matrix, world_from_object(context))
        redraw(context)

    def _move(self, mouse: np.ndarray) -> None:
        if self.kind == "rotate":  # adds up, so that the angle does not jump at half a turn
            centre = self._pivot_px()
            before, now = (np.arctan2(*(place - centre)[::-1]) for place in (self._mouse, mouse))
            self._angle += (now - before + math.pi) % (2 * math.pi) - math.pi
        self._mouse = mouse

    def _key(self, event: Any) -> None:
        if event.type in {"X", "Y", "Z"}:
            again = self._axes == event.type and self._plane == event.shift
            self._axes, self._plane = ("", False) if again else (event.type, event.shift)
        elif event.type in {"MINUS", "NUMPAD_MINUS"}:
            self._typed = self._typed[1:] if self._typed.startswith("-") else "-" + self._typed
        elif event.type == "BACK_SPACE":
            self._typed = self._typed[:-1]
        elif event.type in DIGITS:
            self._typed += DIGITS[event.type]

    def _set_value(self, context: Any, snap: bool, precise: bool) -> None:
        typed = number_of(self._typed)
        step = SNAP[self.kind] * (PRECISE if precise else 1.0) if snap else 0.0

        def rounded(value: Any) -> Any:
            return np.round(np.asarray(value) / step) * step if step else np.asarray(value)

        if self.kind == "translate":
            free = self._offset()
            if typed is not None:
                free = np.zeros(3)
                free[np.argmax(self._mask())] = typed  # along the axis, else along the first that is free
            self.value = rounded(self._mask() * free)
        elif self.kind == "rotate":
            self.axis = self._rotation_axis()
            self.value = float(math.radians(typed) if typed is not None else rounded(self._angle * self._turn()))
        else:
            factor = typed if typed is not None else float(rounded(self._factor()))
            self.value = np.where(self._mask() > 0, factor, 1.0)

    def _mask(self) -> np.ndarray:
        if not self._axes:
            return np.ones(3)
        chosen = np.eye(3)["XYZ".index(self._axes)]
        return 1 - chosen if self._plane else chosen

    def _offset(self) -> np.ndarray:
        """The mouse's way in the plane of the view through the pivot, or along an axis, in the world."""
        to_world = np.linalg.inv(self._camera.camera_from_world[:, :3])
        per_pixel = self._depth() / self._camera.fx
        right_and_up = np.column_stack([to_world[:, 0], -to_world[:, 1]]) * per_pixel
        way = self._mouse - self._begin
        if not self._axes or self._plane:
            return right_and_up @ way
        axis = self._mask()
        on_screen = np.linalg.lstsq(right_and_up, axis, rcond=None)[0]  # pixels per unit along the axis
        length = on_screen @ on_screen
        return axis * (on_screen @ way / length if length > 1e-6 / per_pixel**2 * 1e-3 else way[1] * per_pixel)

    def _rotation_axis(self) -> tuple[float, float, float]:
        if self._axes:
            return tuple(np.eye(3)["XYZ".index(self._axes)])
        return tuple(-self._camera.camera_from_world[2, :3])  # towards the eye, so that it follows the mouse

    def _turn(self) -> float:
        """1 where the axis comes towards the eye, -1 where it goes away: the splats then follow the mouse."""
        return 1.0 if np.dot(self._rotation_axis(), self._camera.camera_from_world[2, :3]) <= 0 else -1.0

    def _factor(self) -> float:
        centre = self._pivot_px()
        begin = max(float(np.linalg.norm(self._begin - centre)), 1.0)
        return max(float(np.linalg.norm(self._mouse - centre)) / begin, 1e-3)

    def _depth(self) -> float:
        depth = float((self._camera.camera_from_world @ np.append(self._pivot, 1.0))[2])
        return depth if self._camera.projection == "pinhole" else 1.0

    def _pivot_px(self) -> np.ndarray:
        camera = self._camera
        x, y, depth = camera.camera_from_world @ np.append(self._pivot, 1.0)
        depth = depth if camera.projection == "pinhole" else 1.0
        return np.array([camera.fx * x / depth + camera.cx, camera.height - (camera.fy * y / depth + camera.cy)])

    def _end(self, context: Any, cancelled: bool) -> set[str]:
        b_data = edited_object(context).data
        done = False
        with Reported(self):
            try:
                if cancelled or self._refusal is not None:
                    self._drag.cancel()
                else:
                    step = self._drag.finish(keep_values=True)
                    done = step is not None and self._session.commit(b_data, step, done=True)
                if self._refusal is not None and not cancelled:
                    raise self._refusal
            finally:
                end_preview(b_data)
                context.area.header_text_set(None)
                context.workspace.status_text_set(None)
                redraw(context)
        return {"FINISHED"} if done else {"CANCELLED"}

    def _say(self, context: Any) -> None:
        shown = {
            "translate": lambda: "Move " + "  ".join(f"D{a}: {v:.4g}" for a, v in zip("XYZ", self.value, strict=True)),
            "rotate": lambda: f"Rotation: {math.degrees(self.value):.2f}°",
            "resize": lambda: "Scale " + "  ".join(f"{a}: {v:.4g}" for a, v in zip("XYZ", self.value, strict=True)),
        }[self.kind]()
        along = (f" in the plane across {self._axes}" if self._plane else f" along global {self._axes}") * bool(
            self._axes
        )
        context.area.header_text_set(f"{shown}{along}" + (f"  [{self._typed}|]" if self._typed else ""))
        context.workspace.status_text_set(
            "Confirm: LMB, Enter    Cancel: RMB, Esc    Axis: X, Y, Z    Plane: Shift-X, Y, Z    "
            "Snap: Ctrl    Numbers: type"
        )


def number_of(typed: str) -> float | None:
    """What was typed so far; None while that is no number."""
    try:
        return float(typed)
    except ValueError:
        return None
