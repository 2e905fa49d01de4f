# SPDX-License-Identifier: GPL-3.0-or-later
"""What the operators of Edit Splats share: they act on the edited capture, all or nothing, and say what went wrong."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import numpy as np

from .. import sync
from .kernels import check_ready
from .mode import Reported, check_any_splats, edited_object
from .session import EditSession, session_of

if TYPE_CHECKING:
    from ...engine.edit.step import Step

SELECT_MODES = (
    ("SET", "Set", "Set a new selection", "SELECT_SET", 0),
    ("ADD", "Extend", "Extend the selection", "SELECT_EXTEND", 1),
    ("SUB", "Subtract", "Take away from the selection", "SELECT_SUBTRACT", 2),
    ("XOR", "Difference", "Invert what is found", "SELECT_DIFFERENCE", 3),
    ("AND", "Intersect", "Keep selected only what is found", "SELECT_INTERSECT", 4),
)
ENGINE_MODES = {"SET": "set", "ADD": "add", "SUB": "subtract", "XOR": "difference", "AND": "intersect"}


class SplatOperator:
    """Makes one step of the edited capture: subclasses say in `step` which."""

    bl_options = {"REGISTER", "UNDO"}  # noqa: RUF012 - Blender reads a set here
    by_hand = False  # whether it was invoked, as in `session_of`

    @classmethod
    def poll(cls, context: Any) -> bool:
        if edited_object(context) is None:
            cls.poll_message_set("Edit the splats of a capture first (Edit Splats)")  # type: ignore[attr-defined]
            return False
        return True

    def invoke(self, context: Any, event: Any) -> set[str]:
        with Reported(self):
            check_ready(device_of(context))
            self.by_hand = True
            return self.execute(context)
        return {"CANCELLED"}

    def execute(self, context: Any) -> set[str]:
        with Reported(self):
            session = session_in(context, self.by_hand)
            step = self.step(context, session)
            if session.commit(edited_object(context).data, step, self.sources(session)):
                redraw(context)
                return {"FINISHED"}
        return {"CANCELLED"}

    def step(self, context: Any, session: EditSession) -> Step:
        raise NotImplementedError

    def sources(self, session: EditSession) -> np.ndarray | None:
        """Of steps that append splats: see `EditSession.commit`. Asked before the step is done."""
        return None


def session_in(context: Any, by_hand: bool = False) -> EditSession:
    """The session of the edited capture; `by_hand` as in `session_of`. Raises StippleError."""
    check_any_splats(edited_object(context))
    with busy(context) as progress:
        return session_of(edited_object(context), device_of(context), progress, by_hand)


def device_of(context: Any) -> str:
    """What the scene's edits run on."""
    return sync.DEVICE[context.scene.stipple.device]


@contextmanager
def busy(context: Any) -> Iterator[Any]:
    """Gives a function (fraction, text) that shows in the status bar, and under the cursor, how far something is."""
    b_manager = context.window_manager
    begun: list[bool] = []

    def progress(fraction: float, text: str) -> None:
        if not begun:
            begun.append(True)
            b_manager.progress_begin(0, 1)
        b_manager.progress_update(fraction)

    try:
        yield progress
    finally:
        if begun:
            b_manager.progress_end()


def redraw(context: Any) -> None:
    """All 3D viewports, for panels count what is selected; nothing without a window."""
    for b_window in context.window_manager.windows:
        for b_area in b_window.screen.areas:
            if b_area.type == "VIEW_3D":
                b_area.tag_redraw()


def world_from_object(context: Any) -> np.ndarray:
    """(3, 4) of the edited capture."""
    return np.array(edited_object(context).matrix_world, np.float64)[:3]
