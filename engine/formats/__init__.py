# SPDX-License-Identifier: GPL-3.0-or-later
"""Files to and from `SplatCloud`s: one file per format, and this registry that picks among them.

| format | read by                                                 | written by  |
|--------|---------------------------------------------------------|-------------|
| `.ply` | `ply_read` (`ply_header`, `ply_layout`, `ply_rows`, `ply_convert`) | `ply_write` |

What the formats share: `splat_source` (an opened capture, read in chunks), `source_file` (opening), `atomic_file`
(replacing files in one step), `splat_format` (what a format is). Importing this package imports neither plyfile,
Warp nor Blender.
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from ..errors import StippleError
from ..progress import Progress
from ..splats import SplatChunk, SplatCloud
from .atomic_file import Place, replacing
from .ply_read import open_ply, starts_like_ply
from .ply_write import write_ply
from .source_file import open_source
from .splat_format import AnyPath, LoadedSplats, SplatFormat
from .splat_source import SplatSource

__all__ = [
    "FORMATS", "LoadedSplats", "SplatSource", "open_splats", "read_splats", "readable_suffixes", "write_splat_chunks",
    "write_splats",
]  # fmt: skip

FORMATS = (SplatFormat("3DGS PLY", (".ply",), starts_like_ply, open_ply, write_ply),)
SIGNATURE_BYTES = 64  # how much of a file's beginning a format may look at to recognise it


def readable_suffixes() -> tuple[str, ...]:
    """The suffixes that can be read, lower case with the dot, for file dialogs."""
    return tuple(suffix for entry in FORMATS for suffix in entry.suffixes)


def open_splats(path: AnyPath) -> SplatSource:
    """Opens a capture and reads its header; what the file begins with decides the format before its suffix does.

    Raises StippleError with one sentence for a file that cannot be opened, is in no known format, or is damaged as far
    as its header and its size tell.
    """
    path = Path(path)
    with open_source(path) as file:
        beginning = file.read(SIGNATURE_BYTES)
    for entry in FORMATS:
        if entry.recognises(beginning):
            return entry.open(path)
    return _format_of_suffix(path, "read").open(path)


def read_splats(path: AnyPath, progress: Progress | None = None) -> LoadedSplats:
    """Reads a whole capture into memory.

    Splats that cannot be rendered are left out and counted (see `LoadedSplats`). Raises StippleError as `open_splats`
    and `SplatSource.read`.
    """
    return open_splats(path).read(progress)


def write_splats(path: AnyPath, cloud: SplatCloud, place: Place = replacing) -> None:
    """Writes a capture in the format of `path`'s suffix, replacing a file that is there in one step.

    Within `atomic_file.replacing_together` the `place` that it gives puts the file off until all are written.
    Raises StippleError for an unknown suffix and where the file cannot be written; nothing half-written stays.
    """
    write_splat_chunks(path, [cloud], cloud.splat_count, cloud.sh_degree, place)


def write_splat_chunks(
    path: AnyPath,
    chunks: Iterable[SplatCloud | SplatChunk],
    splat_count: int,
    sh_degree: int,
    place: Place = replacing,
) -> None:
    """As `write_splats`, of a capture that comes in chunks of one SH degree, `splat_count` splats in all.

    Lets through what the chunks raise.
    """
    path = Path(path)
    _format_of_suffix(path, "written").write(path, chunks, splat_count, sh_degree, place)


def _format_of_suffix(path: Path, done: str) -> SplatFormat:
    for entry in FORMATS:
        if path.suffix.lower() in entry.suffixes:
            return entry
    known = ", ".join(f"{suffix} ({entry.name})" for entry in FORMATS for suffix in entry.suffixes)
    what = f"the suffix {path.suffix!r}" if path.suffix else "a file without a suffix"
    raise StippleError(f"{path}: {what} is not known; splats can be {done} as {known}.")
