# SPDX-License-Identifier: GPL-3.0-or-later
"""Object properties > Splat Sequence."""

from __future__ import annotations

from typing import Any

import bpy

from ..engine.errors import StippleError
from . import residency
from .sequence import playback_of
from .sequence_paths import path_of
from .splat_data import POINT_TYPES, is_capture
from .ui import StipplePanel


class OBJECT_PT_stipple_sequence(StipplePanel, bpy.types.Panel):
    bl_label = "Splat Sequence"
    bl_context = "object"
    bl_options = {"DEFAULT_CLOSED"}  # noqa: RUF012 - Blender reads a set here

    @classmethod
    def poll(cls, context: Any) -> bool:
        b_object = context.object
        return super().poll(context) and b_object and b_object.type in POINT_TYPES and is_capture(b_object.data)

    def draw_header(self, context: Any) -> None:
        self.layout.prop(context.object.stipple_sequence, "enabled", text="")

    def draw(self, context: Any) -> None:
        b_sequence = context.object.stipple_sequence
        column = self._column()
        column.active = b_sequence.enabled
        column.prop(b_sequence, "filepath")
        column.prop(b_sequence, "frame_start")
        column.prop(b_sequence, "speed")
        column.prop(b_sequence, "frame_offset")
        column.prop(b_sequence, "loop")
        if b_sequence.enabled:
            for text in texts_of(context.object, context.scene.frame_current_final):
                column.label(text=text)


def texts_of(b_object: Any, frame: float) -> tuple[str, ...]:
    """What the folder holds and what a frame shows, or what is wrong."""
    try:
        files = residency.sequences.files_of(path_of(b_object))
    except StippleError as error:
        return (str(error),)
    place = playback_of(b_object).place(frame, files.length)
    missing = f", {files.missing} missing" if files.missing else ""
    return (
        f"{len(files.numbers)} files, {files.numbers[0]} to {files.numbers[-1]}{missing}",
        "Nothing at this frame" if place is None else f"Now {files.at(place)[1].name}",
    )


def register() -> None:
    bpy.utils.register_class(OBJECT_PT_stipple_sequence)


def unregister() -> None:
    bpy.utils.unregister_class(OBJECT_PT_stipple_sequence)
