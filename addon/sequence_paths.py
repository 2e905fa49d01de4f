# SPDX-License-Identifier: GPL-3.0-or-later
"""Where an object's sequence lies: paths relative to the .blend file, also after it was saved to another folder.

Blender keeps its own relative paths right when a file is saved elsewhere; those in properties of an add-on it does not
know, so handlers do.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import bpy
from bpy.app.handlers import persistent

from ..engine.errors import StippleError

RELATIVE = "//"
_before_saving: list[tuple[str, str]] = []  # names of the objects whose path was changed, and the path


def path_of(b_object: Any) -> Path:
    """The file that names the object's sequence. Raises StippleError where there is none, or where it has no place."""
    name, b_original = b_object.name, b_object.original
    stored = b_object.stipple_sequence.filepath
    if not stored:
        raise StippleError(f"{name}: the sequence has no file; choose one in Object properties > Splat Sequence.")
    if stored.startswith(RELATIVE) and not (b_original.library or bpy.data.filepath):
        raise StippleError(f"{name}: the sequence's path {stored} is relative to a file that was never saved; save it.")
    return Path(bpy.path.abspath(stored, library=b_original.library))


def stored_path(path: Path) -> str:
    """How a path is kept: relative to the .blend file where the user wants that and it can be."""
    if bpy.data.filepath and bpy.context.preferences.filepaths.use_relative_paths:
        try:
            return bpy.path.relpath(str(path))
        except ValueError:
            pass  # on another drive
    return str(path)


@persistent
def _follow(filepath: str, *_: object) -> None:
    """Before saving to another folder: relative paths of this file's objects become relative to that."""
    _before_saving.clear()
    old, new = os.path.dirname(bpy.data.filepath), os.path.dirname(filepath)
    if not old or not new or os.path.realpath(old) == os.path.realpath(new):
        return
    for b_object in bpy.data.objects:
        b_sequence = b_object.stipple_sequence
        if b_object.library is None and b_sequence.filepath.startswith(RELATIVE):
            _before_saving.append((b_object.name, b_sequence.filepath))
            absolute = bpy.path.abspath(b_sequence.filepath)
            try:
                b_sequence.filepath = bpy.path.relpath(absolute, start=new)
            except ValueError:
                b_sequence.filepath = absolute


@persistent
def _stay(filepath: str, *_: object) -> None:
    """After saving a copy, or in vain: the file that is open has not moved."""
    if bpy.data.filepath != filepath or not os.path.exists(filepath):
        for name, stored in _before_saving:
            bpy.data.objects[name].stipple_sequence.filepath = stored
    _before_saving.clear()


HANDLERS = {"save_pre": _follow, "save_post": _stay, "save_post_fail": _stay}


def register() -> None:
    for name, handler in HANDLERS.items():
        getattr(bpy.app.handlers, name).append(handler)


def unregister() -> None:
    for name, handler in HANDLERS.items():
        getattr(bpy.app.handlers, name).remove(handler)
