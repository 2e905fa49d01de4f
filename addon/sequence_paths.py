# SPDX-License-Identifier: GPL-3.0-or-later
"""Where an object's sequence lies: paths relative to a .blend file, also where that is saved, appended or linked.

Blender keeps its own relative paths right; those in properties of an add-on it does not know. So beside each stands the
folder that it is relative to, and what copies an object or brings it back, as undo does, takes both along. Handlers
make the path relative to the open file again. Where files are read the folder is theirs, for they may have moved.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import bpy
from bpy.app.handlers import persistent

from ..engine.errors import StippleError
from .splat_data import POINT_TYPES

RELATIVE = "//"
APPENDED = ("MAKE_LOCAL", "COPY_LOCAL")
_before_saving: list[tuple[str, str, str]] = []  # of objects whose path was changed: name, path, folder


def path_of(b_object: Any) -> Path:
    """The file that names the object's sequence. Raises StippleError where there is none, or where it has no place."""
    name, stored = b_object.name, b_object.stipple_sequence.filepath
    if not stored:
        raise StippleError(f"{name}: the sequence has no file; choose one in Object properties > Splat Sequence.")
    folder = _folder_of(b_object.original)
    if stored.startswith(RELATIVE) and not folder:
        raise StippleError(f"{name}: the sequence's path {stored} is relative to a file that was never saved; save it.")
    return Path(bpy.path.abspath(stored, start=folder))


def _folder_of(b_object: Any) -> str:
    """What an object's relative path is relative to; "" for a file that was never saved."""
    b_owner = _owner_of(b_object)
    return (not b_owner.library and b_owner.stipple_sequence.relative_to) or _blend_folder(b_owner.library)


def _owner_of(b_object: Any) -> Any:
    """The object that the path was set on: for an override that has the path of the linked object, that one."""
    while (b_override := b_object.override_library) and (b_reference := b_override.reference):
        if b_reference.stipple_sequence.filepath != b_object.stipple_sequence.filepath:
            break
        b_object = b_reference
    return b_object


def _blend_folder(b_library: Any) -> str:
    """The folder of a library, or of the open file for None."""
    return os.path.dirname(bpy.path.abspath(b_library.filepath) if b_library else bpy.data.filepath)


def note_folder(b_object: Any) -> None:
    """After a path was set on an object of this file: it is relative to this file."""
    if not b_object.library:
        b_object.stipple_sequence.relative_to = _blend_folder(None)


def stored_path(path: Path) -> str:
    """How a path is kept: relative to the .blend file where the user wants that and it can be."""
    if bpy.data.filepath and bpy.context.preferences.filepaths.use_relative_paths:
        try:
            return bpy.path.relpath(str(path))
        except ValueError:
            pass  # on another drive
    return str(path)


def _relative() -> Iterator[Any]:
    """Original objects with a relative path. Others get no properties from being looked at."""
    for b_object in bpy.data.objects:
        has_group = b_object.type in POINT_TYPES and b_object.is_property_set("stipple_sequence")
        if has_group and b_object.stipple_sequence.filepath.startswith(RELATIVE):
            yield b_object


def _set_relative_to(b_object: Any, new: str) -> None:
    """Keeps the file that an object's path names, and makes the path relative to another folder, where it can be."""
    b_sequence = b_object.stipple_sequence
    absolute = bpy.path.abspath(b_sequence.filepath, start=_folder_of(b_object))
    try:
        b_sequence.filepath = bpy.path.relpath(absolute, start=new) if new else absolute
    except ValueError:
        b_sequence.filepath = absolute  # on another drive
    b_sequence.relative_to = new


def _follow(new: str) -> Iterator[tuple[str, str, str]]:
    """Relative paths that were set in this file become relative to a folder; yields what those that changed had."""
    for b_object in _relative():
        old = _folder_of(b_object)
        if old and not _owner_of(b_object).library and os.path.realpath(old) != os.path.realpath(new):
            yield b_object.name, b_object.stipple_sequence.filepath, b_object.stipple_sequence.relative_to
            _set_relative_to(b_object, new)


@persistent
def _before_save(filepath: str, *_: object) -> None:
    if filepath:
        _before_saving[:] = _follow(os.path.dirname(filepath))


@persistent
def _after_save(filepath: str, *_: object) -> None:
    """After saving a copy, or in vain: the file that is open has not moved."""
    if bpy.data.filepath != filepath or not os.path.exists(filepath):
        for name, stored, folder in _before_saving:
            b_sequence = bpy.data.objects[name].stipple_sequence
            b_sequence.filepath, b_sequence.relative_to = stored, folder
    _before_saving.clear()


@persistent
def _after_undo(*_: object) -> None:
    """What undo brought back may be from before the file was saved to another folder."""
    for _changed in _follow(_blend_folder(None)):
        pass


@persistent
def _after_load(*_: object) -> None:
    _note_folders(_relative())


@persistent
def _after_import(b_context: Any, *_: object) -> None:
    """Paths of appended and pasted objects were relative to the file they come from, or were copied from."""
    appended = {
        b_item.id: b_item.source_library for b_item in b_context.import_items if b_item.append_action in APPENDED
    }
    _note_folders(b_object for b_object in _relative() if b_object.library)
    for b_object in _relative():
        if b_library := appended.get(b_object):
            b_sequence = b_object.stipple_sequence
            beside = _blend_folder(b_library)
            if os.path.exists(bpy.path.abspath(b_sequence.filepath, start=beside)) or not b_sequence.relative_to:
                b_sequence.relative_to = beside
            _set_relative_to(b_object, _blend_folder(None))


def _note_folders(b_objects: Iterator[Any]) -> None:
    for b_object in b_objects:
        b_object.stipple_sequence.relative_to = _blend_folder(_owner_of(b_object).library)


HANDLERS = {
    "save_pre": _before_save,
    "save_post": _after_save,
    "save_post_fail": _after_save,
    "undo_post": _after_undo,
    "redo_post": _after_undo,
    "load_post": _after_load,
    "blend_import_post": _after_import,
}


def register() -> None:
    for name, handler in HANDLERS.items():
        getattr(bpy.app.handlers, name).append(handler)


def unregister() -> None:
    for name, handler in HANDLERS.items():
        getattr(bpy.app.handlers, name).remove(handler)
