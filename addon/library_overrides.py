# SPDX-License-Identifier: GPL-3.0-or-later
"""Settings of objects that are library overrides: what makes Blender keep each of them, instead of none.

A group of properties exists in an object from its first reading on. Where the linked object has none yet and its
override does, Blender notes one difference, "the whole group", which it cannot apply when the file is read again: all
that was set is gone then. So linked objects, which are never saved here, get their groups before differences are noted.
"""

from __future__ import annotations

import bpy
from bpy.app.handlers import persistent

from .splat_data import POINT_TYPES

GROUPS = ("stipple", "stipple_sequence")  # of objects, those with settings that can be overridden


@persistent
def _make_groups(*_: object) -> None:
    for b_object in bpy.data.objects:
        if b_object.type in POINT_TYPES and (b_object.library or b_object.override_library):
            for name in GROUPS:
                getattr(b_object, name)  # Blender makes what is read


# Before all that Blender notes: at each undo step and in each file. Undo brings linked objects back without a word.
EVENTS = ("load_post", "blend_import_post", "save_pre")


def register() -> None:
    for name in EVENTS:
        getattr(bpy.app.handlers, name).append(_make_groups)


def unregister() -> None:
    for name in EVENTS:
        getattr(bpy.app.handlers, name).remove(_make_groups)
