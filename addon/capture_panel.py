# SPDX-License-Identifier: GPL-3.0-or-later
"""*Object Data properties > Linked Capture*: the file, what is in it, and what has become of it."""

from __future__ import annotations

from typing import Any

import bpy

from ..engine.errors import StippleError
from ..engine.memory import byte_size
from ..engine.splats import packed_bytes_per_splat
from .edits_beside_blend import problems
from .linked_capture import is_linked, path_of
from .linked_edits import edits_path, edits_places, found_edits, has_edits, holds
from .operators.link_captures import OBJECT_OT_stipple_relink_capture, OBJECT_OT_stipple_reload_capture
from .operators.linked_edits import STIPPLE_OT_apply_edits, STIPPLE_OT_discard_edits


class DATA_PT_stipple_linked_capture(bpy.types.Panel):
    bl_label = "Linked Capture"
    bl_space_type = "PROPERTIES"
    bl_region_type = "WINDOW"
    bl_context = "data"

    @classmethod
    def poll(cls, context: Any) -> bool:
        return context.object is not None and is_linked(context.object.data)

    def draw(self, context: Any) -> None:
        layout = self.layout
        layout.use_property_split = True
        layout.use_property_decorate = False
        b_data = context.object.data
        b_capture = b_data.stipple_capture
        if b_capture.file is not None:
            layout.prop(b_capture.file, "filepath", text="File")
        _say(layout, *state_of(b_data))
        row = layout.row(align=True)
        row.operator(OBJECT_OT_stipple_relink_capture.bl_idname, text="Relink", icon="FILEBROWSER")
        row.operator(OBJECT_OT_stipple_reload_capture.bl_idname, text="Reload", icon="FILE_REFRESH")
        column = layout.column(align=True)
        for line in facts_of(b_data):
            column.label(text=line)
        if has_edits(b_data):
            _say(layout, *edits_state_of(b_data))
            row = layout.row(align=True)
            row.operator(STIPPLE_OT_apply_edits.bl_idname, text="Apply to Copy", icon="EXPORT")
            row.operator(STIPPLE_OT_discard_edits.bl_idname, text="Discard", icon="X")


def _say(layout: Any, text: str, icon: str) -> None:
    row = layout.row()
    row.alert = icon == "ERROR"
    row.label(text=text, icon=icon)


def edits_state_of(b_data: Any) -> tuple[str, str]:
    """A few words on where the edits are, and the icon that goes with them."""
    if b_data.session_uid in problems:
        return "Edits were not saved: see the console", "ERROR"
    try:
        found = found_edits(b_data, b_data.name)
    except StippleError:
        places, path = edits_places(b_data), edits_path(b_data)
        if path is not None:
            return f"Edits: {path.name} is damaged", "ERROR"
        return f"Edits: {places[0].name} is missing" if places else "Edits are missing", "ERROR"
    beside = edits_places(b_data)[:1] if bpy.data.filepath else []
    if found is None or not any(holds(path, found.edits.token) for path in beside):
        return "Edited; saved with the .blend file", "INFO"
    return f"Edits: {beside[0].name}", "GREASEPENCIL"


def state_of(b_data: Any) -> tuple[str, str]:
    """A few words on the file, and the icon that goes with them; looks at the disk and opens nothing."""
    path = path_of(b_data)
    if path is None:
        return "The link was deleted", "ERROR"
    try:
        status = path.stat()
    except OSError:
        return "The file is missing", "ERROR"
    size, date, _ = b_data.stipple_capture.fingerprint.split()
    if (status.st_size, status.st_mtime_ns) != (int(size), int(date)):
        return "Changed on disk; reload the points", "INFO"
    return f"Linked, {byte_size(status.st_size)}", "LINKED"


def facts_of(b_data: Any) -> list[str]:
    """What is known of the capture, line by line."""
    b_capture = b_data.stipple_capture
    packed = b_capture.splat_count * packed_bytes_per_splat(b_capture.sh_degree)
    size = [high - low for low, high in zip(b_capture.bounds_low, b_capture.bounds_high, strict=True)]
    shown = len(b_data.attributes["position"].data)
    return [
        f"{b_capture.splat_count:,} splats, SH degree {b_capture.sh_degree}",
        f"{byte_size(packed)} to render",
        f"{size[0]:.4g} × {size[1]:.4g} × {size[2]:.4g}",
        f"{shown:,} proxy points",
    ]


def register() -> None:
    bpy.utils.register_class(DATA_PT_stipple_linked_capture)


def unregister() -> None:
    bpy.utils.unregister_class(DATA_PT_stipple_linked_capture)
