# SPDX-License-Identifier: GPL-3.0-or-later
"""Files to and from `SplatCloud`s: one file per format, and this registry that picks among them.

| format | read by                                  | written by  |
|--------|------------------------------------------|-------------|
| `.ply` | `ply_read` (`ply_header`, `ply_layout`, `ply_rows`) | `ply_write` |

What the formats share: `source_file` (opening), `atomic_file` (replacing a file in one step), `splat_format`
(what a format is). Importing this package imports neither plyfile, Warp nor Blender.
"""

from __future__ import annotations

from pathlib import Path

from ..errors import StippleError
from ..splats import SplatCloud
from .ply_read import read_ply, starts_like_ply
from .ply_write import write_ply
from .source_file import open_source
from .splat_format import AnyPath, LoadedSplats, SplatFormat

__all__ = ["FORMATS", "LoadedSplats", "read_splats", "readable_suffixes", "write_splats"]

FORMATS = (SplatFormat("3DGS PLY", (".ply",), starts_like_ply, read_ply, write_ply),)
SIGNATURE_BYTES = 64  # how much of a file's beginning a format may look at to recognise it


def readable_suffixes() -> tuple[str, ...]:
    """The suffixes that can be read, lower case with the dot, for file dialogs."""
    return tuple(suffix for entry in FORMATS for suffix in entry.suffixes)


def read_splats(path: AnyPath) -> LoadedSplats:
    """Reads a capture; what the file begins with decides the format, its suffix only where that tells nothing.

    Splats that cannot be rendered are left out and counted (see `LoadedSplats`). Raises StippleError with one
    sentence for a file that cannot be opened, is in no known format, or is damaged.
    """
    path = Path(path)
    with open_source(path) as file:
        beginning = file.read(SIGNATURE_BYTES)
    for entry in FORMATS:
        if entry.recognises(beginning):
            return entry.read(path)
    return _format_of_suffix(path, "read").read(path)


def write_splats(path: AnyPath, cloud: SplatCloud) -> None:
    """Writes a capture in the format of `path`'s suffix, replacing a file that is there in one step.

    Raises StippleError for an unknown suffix and where the file cannot be written; nothing half-written stays.
    """
    path = Path(path)
    _format_of_suffix(path, "written").write(path, cloud)


def _format_of_suffix(path: Path, done: str) -> SplatFormat:
    for entry in FORMATS:
        if path.suffix.lower() in entry.suffixes:
            return entry
    known = ", ".join(f"{suffix} ({entry.name})" for entry in FORMATS for suffix in entry.suffixes)
    what = f"the suffix {path.suffix!r}" if path.suffix else "a file without a suffix"
    raise StippleError(f"{path}: {what} is not known; splats can be {done} as {known}.")
