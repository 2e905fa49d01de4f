# SPDX-License-Identifier: GPL-3.0-or-later
"""Edit Splats, the mode: a mark on the object, for Blender has no modes of an add-on's own.

An object stays in it when another becomes active, as Blender's objects stay in their modes; keys, tools and operators
act on the active object while it is marked. The mark is part of the file and of every undo step.
"""

from __future__ import annotations

import logging
from typing import Any

import bpy
import numpy as np
from bpy.props import BoolProperty

from ...engine.edit.state_bits import DELETED
from ...engine.errors import StippleError
from ..linked_capture import is_linked
from ..linked_edits import found_edits
from ..point_rows import check_points_only, replace_points
from ..splat_data import is_capture_object, splat_count_of, states_of, usable_rows, write_states
from . import kernels, session
from .solid import show_points

MARK = "stipple_editing"
log = logging.getLogger(__package__)


def edited_object(context: Any) -> Any:
    """The active object while it is a capture in Edit Splats; else None."""
    b_object = getattr(context, "object", None)
    if not is_capture_object(b_object) or context.mode != "OBJECT" or not getattr(b_object, MARK):
        return None
    return b_object


class OnActiveCapture:
    """Operators on the active object where it is a capture, in Object Mode or in Edit Splats."""

    bl_options = {"REGISTER", "UNDO"}  # noqa: RUF012 - Blender reads a set here

    @classmethod
    def poll(cls, context: Any) -> bool:
        if context.mode == "OBJECT" and is_capture_object(getattr(context, "object", None)):
            return True
        cls.poll_message_set("Make a capture the active object in Object Mode")  # type: ignore[attr-defined]
        return False


class STIPPLE_OT_edit_mode_toggle(OnActiveCapture, bpy.types.Operator):
    """Edit the splats of the active capture, or go back to whole objects; deleted splats are taken out on leaving"""

    bl_idname = "stipple.edit_mode_toggle"
    bl_label = "Edit Splats"

    def execute(self, context: Any) -> set[str]:
        b_object = context.object
        with Reported(self):
            if edited_object(context):
                leave(b_object)
            else:
                session.check_editable(b_object)
                check_any_splats(b_object)
                if is_linked(b_object.data):
                    found_edits(b_object.data, b_object.name)  # says now what is wrong with them
                setattr(b_object, MARK, True)
                show_points(b_object.data, True)
                if not bpy.app.background:
                    from ..sync import DEVICE  # which imports this module

                    kernels.begin(DEVICE[context.scene.stipple.device])
            b_object.data.update_tag()  # viewports show flags or no longer do
            return {"FINISHED"}
        return {"CANCELLED"}


def check_any_splats(b_object: Any) -> None:
    """Raises StippleError for a capture that holds none: a script or Blender's own edit mode took them away."""
    if splat_count_of(b_object.data) == 0:
        raise StippleError(f"{b_object.name}: it has no splats; import the file again, or undo what took them away.")


def leave(b_object: Any) -> None:
    """Takes deleted splats out of the datablock, then the mark off the object. All or nothing; StippleError says why.

    A capture keeps its mark while every splat is deleted: no splats would be no capture. Those of a linked capture stay
    in their file, and what is deleted can be restored later, too.
    """
    b_data = b_object.data
    states = states_of(b_data)
    deleted = np.zeros(0, bool) if states is None else (states & DELETED) != 0
    if deleted.all() and deleted.size:
        raise StippleError(f"{b_object.name}: every splat is deleted; restore some, or delete the object.")
    if deleted.any():
        keep_rows(b_data, ~deleted, b_object.name)
    setattr(b_object, MARK, False)
    show_points(b_data, _is_edited(b_data))
    session.drop(b_data)


def _is_edited(b_data: Any) -> bool:
    """Whether an object in Edit Splats has this data: objects may share it, and so the points that Blender draws."""
    return b_data.users > 1 and any(b_other.data == b_data and getattr(b_other, MARK) for b_other in bpy.data.objects)


def keep_rows(b_data: Any, kept: np.ndarray, name: str) -> None:
    """Takes all points out but those where `kept` (N,) is true."""
    check_points_only(b_data, name)
    replace_points(b_data, np.flatnonzero(kept), name)
    states = states_of(b_data)
    if states is not None:
        write_states(b_data, states)
    b_data.update_tag()


class STIPPLE_OT_delete_invalid(OnActiveCapture, bpy.types.Operator):
    """Take out splats that cannot be drawn: values that are no numbers, negative sizes, no orientation"""

    bl_idname = "stipple.delete_invalid"
    bl_label = "Delete Invalid"

    def execute(self, context: Any) -> set[str]:
        b_object = context.object
        with Reported(self):
            session.check_editable(b_object)
            if is_linked(b_object.data):
                raise StippleError(f"{b_object.name}: invalid splats of a linked capture are never shown; keep them.")
            check_any_splats(b_object)
            usable = usable_rows(b_object.data, b_object.name)
            if not usable.any():
                raise StippleError(f"{b_object.name}: no splat is valid; import the file again.")
            count = splat_count_of(b_object.data) - int(usable.sum())
            if count:
                keep_rows(b_object.data, usable, b_object.name)
            self.report({"INFO"}, f"{b_object.name}: {count:,} invalid splats deleted.")
            return {"FINISHED"} if count else {"CANCELLED"}
        return {"CANCELLED"}


class Reported:
    """Turns what goes wrong inside into one sentence for the user; whatever raised it has left the data as it was."""

    def __init__(self, operator: Any) -> None:
        self._operator = operator

    def __enter__(self) -> None: ...

    def __exit__(self, kind: type | None, error: BaseException | None, trace: object) -> bool:
        if isinstance(error, StippleError):
            text = str(error)
        elif isinstance(error, MemoryError):
            text = "There is not enough memory for this edit; nothing was changed."
        elif isinstance(error, Exception):
            log.error("Unexpected error in %s", self._operator.bl_idname, exc_info=error)
            text = f"{self._operator.bl_label}: {type(error).__name__}: {error} (details are in the console)."
        else:
            return False
        self._operator.report({"ERROR"}, text)
        return True


CLASSES = (STIPPLE_OT_edit_mode_toggle, STIPPLE_OT_delete_invalid)


def register() -> None:
    setattr(bpy.types.Object, MARK, BoolProperty(name="Edit Splats", options={"HIDDEN"}))
    for cls in CLASSES:
        bpy.utils.register_class(cls)


def unregister() -> None:
    for cls in reversed(CLASSES):
        bpy.utils.unregister_class(cls)
    delattr(bpy.types.Object, MARK)
