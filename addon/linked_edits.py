# SPDX-License-Identifier: GPL-3.0-or-later
"""Edits of linked captures: a token in the datablock, the edits in memory, a file beside the .blend when that is saved.

`data.stipple_capture.edits` is a hash of the edits, and all that Blender's undo sees of them. What a token stands for
is kept here as long as Blender can undo or redo to it, for a state of an edit is small and shares what did not change
with the one before. Saving the .blend writes the edits of every linked capture in it first (`edits_beside_blend`), so
that the token in the .blend always has its file.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import bpy

from ..engine.capture_file import CaptureFile
from ..engine.edit.capture_edits import CaptureEdits
from ..engine.edit.edited_capture import EditedCapture, same_values
from ..engine.edit.edits_file import read_edits
from ..engine.errors import StippleError
from .kept_for_file import kept_for_file

BACKUP = "1"  # what the file of the save before ends with, as Blender's .blend1 does
DISCARD = "show the capture without them by Object Data properties > Linked Capture > Discard"
FEWEST_KEPT = 16
FEWEST_SHOWN = 2  # each holds four bytes per splat


@dataclass(frozen=True)
class FoundEdits:
    """The edits of a datablock, and what the user should know about them; "" for nothing."""

    edits: CaptureEdits
    notice: str = ""


Stamp = tuple[int, int]  # size and date of a file

_kept: dict[str, CaptureEdits] = {}  # by token
_states: dict[int, list[str]] = {}  # by session_uid of a datablock: the tokens it went through, the newest at the end
_files: dict[Path, tuple[Stamp, CaptureEdits]] = {}  # what files were found to hold
_shown: list[EditedCapture] = []  # the one used last at the end


def has_edits(b_data: Any) -> bool:
    """Whether a linked datablock is edited, or was when the .blend was saved."""
    return bool(b_data.stipple_capture.edits)


def put_edits(b_data: Any, edits: CaptureEdits) -> None:
    """Makes these the edits of a datablock. Undo brings the ones before back."""
    _kept[edits.token] = edits
    _change_token(b_data, "" if edits.is_empty else edits.token)


def discard_edits(b_data: Any) -> None:
    """Shows the capture as its file has it; a file of edits stays where it is. Undo brings the edits back."""
    _change_token(b_data, "")


def found_edits(b_data: Any, name: str) -> FoundEdits | None:
    """The edits of a linked datablock, original or evaluated, from memory or from their file; None without any.

    Where the file holds another state of the edits than the .blend was saved with, that is taken, with a notice.
    Raises StippleError where there is no such file or it is damaged.
    """
    token = b_data.stipple_capture.edits
    if not token:
        return None
    if token in _kept:
        return FoundEdits(_kept[token])
    path, edits = _stored(edits_places(b_data), token, name)
    _kept[edits.token] = edits
    if edits.token == token:
        return FoundEdits(edits)
    return FoundEdits(edits, f"{name}: {path.name} holds other edits than the .blend was saved with; they are shown.")


def edited_capture(capture: CaptureFile, edits: CaptureEdits) -> EditedCapture:
    """The same object for the same edits, and the same edited splats where only flags differ, so that each is uploaded
    once. Raises StippleError where the edits are of a file of other content."""
    alike = None
    for known in reversed(_shown):
        if known.capture is capture and known.edits.token == edits.token:
            _shown.remove(known)
            _shown.append(known)
            return known
        if alike is None and known.capture is capture and same_values(known.edits, edits):
            alike = known.rows
    edited = EditedCapture(capture, edits, alike)
    _shown.append(edited)
    linked_count = sum(1 for b_data in linked_data() if has_edits(b_data))
    del _shown[: -max(FEWEST_SHOWN, 2 * linked_count)]
    return edited


def _change_token(b_data: Any, token: str) -> None:
    """Sets another token, and forgets what the ones stand for that no undo or redo can ask for any more.

    A change ends what could be redone: what came after the token of before, were it by a slider of the redo panel,
    which undoes and does again with every value. Of what can be undone as many are kept as Blender has steps.
    """
    before = b_data.stipple_capture.edits
    b_data.stipple_capture.edits = token
    b_data.update_tag()
    states = _states.setdefault(b_data.session_uid, [])
    old = list(states)
    if before in states:
        del states[len(states) - states[::-1].index(before) :]
    else:
        states.append(before)
    states.append(token)
    del states[: -max(FEWEST_KEPT, bpy.context.preferences.edit.undo_steps + 2)]
    needed = {b_other.stipple_capture.edits for b_other in linked_data()}.union(*_states.values())
    for gone in set(old) - needed:
        _kept.pop(gone, None)


def linked_data() -> list[Any]:
    """Every datablock of this .blend that stands for a file."""
    b_datas = [*bpy.data.pointclouds, *bpy.data.meshes]
    return [b_data for b_data in b_datas if b_data.stipple_capture.fingerprint]


def edits_places(b_data: Any) -> list[Path]:
    """Where the edits may be that were written when the .blend was saved: beside the .blend, which may have been moved
    with them; else where they were written, for an appended datablock is in another .blend than the one it was saved
    with. None before it was saved.
    """
    b_capture, library = b_data.stipple_capture, b_data.library
    blend = bpy.path.abspath(library.filepath) if library is not None else bpy.data.filepath
    folders = [str(Path(blend).parent)] if blend else []
    folders += [b_capture.edits_folder] if b_capture.edits_folder else []
    return [Path(folder) / b_capture.edits_file for folder in dict.fromkeys(folders)] if b_capture.edits_file else []


def edits_path(b_data: Any) -> Path | None:
    """The first of those places where there is a file; None where there is none."""
    return next((place for place in edits_places(b_data) if place.is_file()), None)


def note_file(path: Path, edits: CaptureEdits) -> None:
    """Remembers what a file holds that was just written."""
    _files[path] = (_stamp(path), edits)


def holds(path: Path, token: str) -> bool:
    """Whether a file is known to hold these edits, as far as its size and date tell."""
    known = _files.get(path)
    return known is not None and path.is_file() and known[0] == _stamp(path) and known[1].token == token


def _stored(places: list[Path], token: str, name: str) -> tuple[Path, CaptureEdits]:
    """The edits that were asked for, of the save before where only that has them; else what the first file holds."""
    for place in places:
        for path in (place, place.with_name(place.name + BACKUP)):
            with suppress(StippleError):  # worth an error only if there is no other
                if path.is_file() and _read(path).token == token:
                    return place, _read(path)
    for place in places:
        if place.exists():
            return place, _read(place)
    if not places:
        raise StippleError(f"{name}: its edits were not saved with the .blend file; undo, or {DISCARD}.")
    where = " or ".join(map(str, places))
    raise StippleError(f"{name}: its edits are missing, there is no such file as {where}; put it back, or {DISCARD}.")


def _read(path: Path) -> CaptureEdits:
    stamp = _stamp(path) if path.is_file() else (0, 0)
    if path not in _files or _files[path][0] != stamp:
        try:
            _files[path] = (stamp, read_edits(path))
        except StippleError:
            _files.pop(path, None)
            raise
    return _files[path][1]


def _stamp(path: Path) -> Stamp:
    status = path.stat()
    return status.st_size, status.st_mtime_ns


def free() -> None:
    _kept.clear()
    _states.clear()
    _files.clear()
    _shown.clear()


register, unregister = kept_for_file(free)
