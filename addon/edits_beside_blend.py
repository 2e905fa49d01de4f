# SPDX-License-Identifier: GPL-3.0-or-later
"""Writes the edits of linked captures beside the .blend whenever that is saved, before it is.

`shot.blend` with a datablock `garden` gets `shot.garden.edits.npz`; of what was there before, one copy stays, as
Blender keeps a `.blend1`. Saving under another name or in another folder writes the files there, too. Edits that
cannot be read are not replaced: their file is copied along as it is. Nothing can stop Blender from saving, so what goes
wrong is said in the console and in the panel *Linked Capture*.
"""

from __future__ import annotations

import logging
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import bpy
from bpy.app.handlers import persistent

from ..engine.edit.capture_edits import CaptureEdits
from ..engine.edit.edits_file import SUFFIX, write_edits
from ..engine.errors import StippleError
from ..engine.formats.atomic_file import replacing
from .file_names import free_name
from .linked_capture import path_of
from .linked_edits import BACKUP, edits_path, found_edits, has_edits, holds, linked_data, note_file

problems: dict[int, str] = {}
"""What kept edits from being written, by session_uid of the datablock."""

log = logging.getLogger(__package__)


def write_beside(blend: Path) -> None:
    """Writes the edits of every linked capture for a .blend that is about to be saved there.

    All are read first: where datablocks changed names, one's file may be about to become another's.
    """
    problems.clear()
    taken: set[str] = set()
    to_write: list[tuple[Any, Path, CaptureEdits | bytes]] = []
    for b_data in linked_data():
        if b_data.library is None and has_edits(b_data):
            target = blend.with_name(free_name(f"{blend.stem}.", b_data.name, SUFFIX, taken))
            with _noting_problem(b_data):
                to_write.append((b_data, target, _read(b_data)))
    for b_data, target, content in to_write:
        with _noting_problem(b_data):
            _write(b_data, target, content)
            b_data.stipple_capture.edits_file = target.name
            b_data.stipple_capture.edits_folder = str(target.parent)


@contextmanager
def _noting_problem(b_data: Any) -> Iterator[None]:
    try:
        yield
    except StippleError as error:
        problems[b_data.session_uid] = str(error)
        log.error("The edits of %s were not saved: %s", b_data.name, error)


def _read(b_data: Any) -> CaptureEdits | bytes:
    """The edits of a datablock that has some; of those that cannot be read, their file as it is."""
    try:
        found = found_edits(b_data, b_data.name)
    except StippleError:
        path = edits_path(b_data)
        if path is None:
            raise
        return _bytes_of(path)
    assert found is not None
    return found.edits


def _write(b_data: Any, target: Path, content: CaptureEdits | bytes) -> None:
    if isinstance(content, bytes):
        if not target.is_file() or _bytes_of(target) != content:
            _put_bytes(target, content)
        return
    b_data.stipple_capture.edits = content.token  # another one where the file had been changed
    if holds(target, content.token):
        return
    if target.is_file() and bpy.context.preferences.filepaths.save_version:
        with suppress(StippleError):  # a backup that cannot be had is no reason not to save
            _put_bytes(target.with_name(target.name + BACKUP), _bytes_of(target))
    path = path_of(b_data)
    write_edits(target, content, path.name if path else b_data.name, b_data.stipple_capture.sh_degree)
    note_file(target, content)


def _bytes_of(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except OSError as error:
        raise StippleError(f"{path}: it cannot be read ({error.strerror}).") from error


def _put_bytes(target: Path, data: bytes) -> None:
    with replacing(target) as file:
        file.write(data)


@persistent
def _before_saving(path: str = "", *_: object) -> None:
    if path:  # else the startup file
        write_beside(Path(bpy.path.abspath(path)))


def register() -> None:
    bpy.app.handlers.save_pre.append(_before_saving)


def unregister() -> None:
    bpy.app.handlers.save_pre.remove(_before_saving)
    problems.clear()
