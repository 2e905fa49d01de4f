# SPDX-License-Identifier: GPL-3.0-or-later
"""Edits of a linked capture: applied to a copy of its file, or discarded."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import bpy
from bpy.props import BoolProperty, EnumProperty, StringProperty
from bpy_extras.io_utils import ExportHelper

from ...engine.capture_file import CaptureFile
from ...engine.errors import Cancelled, StippleError
from ..edit.mode import Reported
from ..edit.solid import show_points
from ..linked_capture import link_anew
from ..linked_edits import discard_edits, found_edits, has_edits
from ..preferences import cache_places
from ..residency import linked
from .link_captures import OnLinkedCapture, shown_progress

CONTENTS = (
    ("ALL", "All", "Every splat that is not deleted"),
    ("SELECTED", "Selected", "Only splats that are selected in Edit Splats"),
)


class STIPPLE_OT_apply_edits(OnLinkedCapture, ExportHelper, bpy.types.Operator):
    """Write a copy of the linked capture with the edits in it, in full precision; the file itself stays as it is"""

    bl_idname = "stipple.apply_edits"
    bl_label = "Apply Edits to Copy"

    filename_ext = ".ply"
    filter_glob: StringProperty(default="*.ply", options={"HIDDEN"})  # type: ignore[valid-type]
    content: EnumProperty(  # type: ignore[valid-type]
        name="Include", description="What is written", items=CONTENTS, options={"SKIP_SAVE"}
    )
    relink: BoolProperty(  # type: ignore[valid-type]
        name="Relink", description="Let the object stand for the copy from now on, without edits", default=True
    )

    def invoke(self, context: Any, event: Any) -> set[str]:
        self.filepath = bpy.path.clean_name(f"{context.object.name}_edited") + self.filename_ext
        context.window_manager.fileselect_add(self)
        return {"RUNNING_MODAL"}

    def execute(self, context: Any) -> set[str]:
        path = Path(bpy.path.abspath(self.filepath))
        with Reported(self):
            try:
                with shown_progress(context) as progress:
                    count = self._write(context.object, path, progress)
                    if self.relink and self.content == "ALL":
                        self._relink(context.object.data, path, progress)
            except (Cancelled, KeyboardInterrupt) as error:
                raise StippleError(f"{path.name}: cancelled; nothing was changed.") from error
            self.report({"INFO"}, f"{path.name}: {count:,} splats.")
            return {"FINISHED"}
        return {"CANCELLED"}

    def _write(self, b_object: Any, path: Path, progress: Any) -> int:
        from ...engine.edit.edited_copy import write_edited_copy

        found = found_edits(b_object.data, b_object.name)
        if found is None:
            raise StippleError(f"{b_object.name}: it has no edits; copy its file instead.")
        if found.notice:
            self.report({"WARNING"}, found.notice)
        capture = linked.capture_of(b_object.data, b_object.name)
        return write_edited_copy(capture, found.edits, path, progress, selected_only=self.content == "SELECTED")

    def _relink(self, b_data: Any, path: Path, progress: Any) -> None:
        capture = CaptureFile.open(path, cache_places())
        link_anew(b_data, capture, capture.survey(progress))
        discard_edits(b_data)


class STIPPLE_OT_discard_edits(OnLinkedCapture, bpy.types.Operator):
    """Show the linked capture as its file has it, without edits"""

    bl_idname = "stipple.discard_edits"
    bl_label = "Discard Edits"

    @classmethod
    def poll(cls, context: Any) -> bool:
        if not super().poll(context):
            return False
        if not has_edits(context.object.data):
            cls.poll_message_set("The capture has no edits")
            return False
        return True

    def execute(self, context: Any) -> set[str]:
        discard_edits(context.object.data)
        show_points(context.object.data, False)
        return {"FINISHED"}


CLASSES = (STIPPLE_OT_apply_edits, STIPPLE_OT_discard_edits)

register, unregister = bpy.utils.register_classes_factory(CLASSES)
