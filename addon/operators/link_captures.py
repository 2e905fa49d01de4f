# SPDX-License-Identifier: GPL-3.0-or-later
"""Captures that stay in their file: made, chosen anew, read again."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import bpy
from bpy.props import StringProperty

from ...engine.capture_file import CaptureFile, Survey
from ...engine.errors import Cancelled, StippleError
from ..linked_capture import is_linked, new_linked_data, path_of, relink
from ..preferences import cache_places

log = logging.getLogger(__package__)


@contextmanager
def shown_progress(context: Any) -> Iterator[Callable[[float, str], None]]:
    """A progress callback that shows in Blender's cursor."""
    b_manager = context.window_manager
    b_manager.progress_begin(0, 100)
    try:
        yield lambda fraction, text: b_manager.progress_update(int(100 * fraction))
    finally:
        b_manager.progress_end()


def linked_data_from_file(context: Any, path: Path) -> tuple[Any, tuple[str, ...]]:
    """A new datablock that stands for the file, and warnings. Raises StippleError."""
    capture, survey, warnings = _survey(context, path)
    return new_linked_data(capture, survey, path.stem), warnings


def _survey(context: Any, path: Path) -> tuple[CaptureFile, Survey, tuple[str, ...]]:
    capture = CaptureFile.open(path, cache_places())
    with shown_progress(context) as progress:
        survey = capture.survey(progress)
    return capture, survey, survey.dropped.warnings(capture.path, capture.splat_count)


class OnLinkedCapture:
    """Operators on the active object where it is a linked capture."""

    bl_options = {"REGISTER", "UNDO"}  # noqa: RUF012 - Blender reads a set here

    @classmethod
    def poll(cls, context: Any) -> bool:
        b_object = context.object
        if b_object is None or not is_linked(b_object.data):
            cls.poll_message_set("Select a linked capture")  # type: ignore[attr-defined]
            return False
        if not b_object.data.is_editable:
            cls.poll_message_set("The capture is linked from another .blend file")  # type: ignore[attr-defined]
            return False
        return True

    def _read(self, context: Any, b_data: Any, path: Path) -> bool:
        """Makes a datablock stand for the file; reports what is wrong and returns whether nothing was."""
        report = self.report  # type: ignore[attr-defined]
        try:
            capture, survey, warnings = _survey(context, path)
            relink(b_data, capture, survey)
        except StippleError as error:
            report({"ERROR"}, str(error))
        except (Cancelled, KeyboardInterrupt):
            report({"WARNING"}, f"{path.name}: cancelled; nothing was changed.")
        except MemoryError:
            report({"ERROR"}, f"{path.name}: there is not enough memory to read it.")
        except Exception as error:
            log.exception("Unexpected error while linking %s", path)
            report({"ERROR"}, f"{path.name}: linking failed: {type(error).__name__}: {error} (see the console).")
        else:
            for warning in warnings:
                report({"WARNING"}, warning)
            return True
        return False


class OBJECT_OT_stipple_relink_capture(OnLinkedCapture, bpy.types.Operator):
    """Choose the file of a linked capture anew. Others that are missing are looked for in the same folder"""

    bl_idname = "object.stipple_relink_capture"
    bl_label = "Relink Capture"

    filepath: StringProperty(  # type: ignore[valid-type]
        subtype="FILE_PATH", options={"SKIP_SAVE", "HIDDEN", "PATH_SUPPORTS_BLEND_RELATIVE"}
    )
    filter_glob: StringProperty(default="*.ply", options={"HIDDEN"})  # type: ignore[valid-type]

    def invoke(self, context: Any, event: Any) -> set[str]:
        context.window_manager.fileselect_add(self)
        return {"RUNNING_MODAL"}

    def execute(self, context: Any) -> set[str]:
        path = Path(bpy.path.abspath(self.filepath))
        if not self._read(context, context.object.data, path):
            return {"CANCELLED"}
        found = 0
        for b_data in _missing():
            candidate = path.parent / (path_of(b_data) or path).name
            if candidate.is_file() and candidate != path:
                found += self._read(context, b_data, candidate)
        others = f" So are {found} more that were found beside it." if found else ""
        self.report({"INFO"}, f"{path.name} is linked.{others}")
        return {"FINISHED"}


class OBJECT_OT_stipple_reload_capture(OnLinkedCapture, bpy.types.Operator):
    """Read a linked capture's file again: its points, bounds and counts"""

    bl_idname = "object.stipple_reload_capture"
    bl_label = "Reload Capture"

    def execute(self, context: Any) -> set[str]:
        path = path_of(context.object.data)
        if path is None:
            self.report({"ERROR"}, f"{context.object.name}: the link to its file was deleted; relink it.")
            return {"CANCELLED"}
        return {"FINISHED"} if self._read(context, context.object.data, path) else {"CANCELLED"}


def _missing() -> list[Any]:
    """Linked datablocks of this .blend whose file is not there."""
    b_datas = [*bpy.data.pointclouds, *bpy.data.meshes]
    linked = [b_data for b_data in b_datas if b_data.is_editable and is_linked(b_data)]
    return [b_data for b_data in linked if (path := path_of(b_data)) is not None and not path.is_file()]


CLASSES = (OBJECT_OT_stipple_relink_capture, OBJECT_OT_stipple_reload_capture)


def register() -> None:
    for cls in CLASSES:
        bpy.utils.register_class(cls)


def unregister() -> None:
    for cls in reversed(CLASSES):
        bpy.utils.unregister_class(cls)
