# SPDX-License-Identifier: GPL-3.0-or-later
"""Edits applied to a copy of the capture: a new file, written while the old one is read, a chunk of it in memory.

The copy is made of the file's own values in full precision, not of the quantised ones that are shown meanwhile.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import numpy.typing as npt

from ..capture_file import CaptureFile
from ..device import choose_device
from ..errors import StippleError
from ..formats import write_splat_chunks
from ..memory import gibibytes, host_free_bytes
from ..progress import Progress
from ..splats import ARRAY_NAMES, SplatChunk, SplatCloud, full_bytes_per_splat
from .capture_edits import VALUES, CaptureEdits, check_edits_of
from .editable_cloud import EditableCloud
from .edited_values import put_values


def write_edited_copy(
    capture: CaptureFile,
    edits: CaptureEdits,
    path: Path,
    progress: Progress | None = None,
    *,
    selected_only: bool = False,
) -> int:
    """Writes the capture with its edits in the format of `path`'s suffix, and returns how many splats it has.

    Deleted splats are left out, and with `selected_only` what is not selected (or hidden, or locked) too. The file is
    replaced in one step. Raises StippleError for edits of another capture, where `path` is the capture itself or cannot
    be written, or nothing would be left; lets `Cancelled` and KeyboardInterrupt through, and leaves nothing then.
    """
    check_edits_of(capture.path, capture.fingerprint, edits)
    if os.path.realpath(path) == os.path.realpath(capture.path):
        raise StippleError(f"{path}: this is the capture itself, which stays as it is; choose another name.")
    counts = edits.counts
    count = counts["selected"] if selected_only else edits.splat_count - counts["deleted"]
    if count == 0:
        which = "selected" if selected_only else "left"
        raise StippleError(f"{capture.name}: no splats are {which}; select or restore some.")
    chunks = _edited_chunks(capture, edits, progress, selected_only)
    write_splat_chunks(path, chunks, count, capture.sh_degree)
    return count


def read_selection(
    capture: CaptureFile, edits: CaptureEdits, name: str, progress: Progress | None = None
) -> SplatCloud:
    """What is selected (and neither hidden nor locked), with its edits: a cloud in memory, in full precision.

    Reads the whole file. Raises StippleError as `write_edited_copy`, and where memory does not suffice.
    """
    check_edits_of(capture.path, capture.fingerprint, edits)
    count = edits.counts["selected"]
    needed, free = 2 * count * full_bytes_per_splat(capture.sh_degree), host_free_bytes()
    if count == 0:
        raise StippleError(f"{capture.name}: no splats are selected; select some.")
    if needed > free:
        raise StippleError(
            f"{capture.name}: {gibibytes(needed)} are needed for {count:,} splats and {gibibytes(free)} are free; "
            "select fewer, or apply the edits to a copy."
        )
    chunks = list(_edited_chunks(capture, edits, progress, selected_only=True))
    return SplatCloud(**{key: np.concatenate([getattr(c, key) for c in chunks]) for key in ARRAY_NAMES}, name=name)


def _edited_chunks(
    capture: CaptureFile, edits: CaptureEdits, progress: Progress | None, selected_only: bool
) -> Iterator[SplatChunk]:
    begin = 0
    for chunk in capture.source().chunks(progress=progress):
        end = begin + chunk.splat_count
        if end > edits.splat_count:
            break  # the writer finds that the number is wrong
        rows = np.arange(begin, end, dtype=np.int32)
        edited = _with_values(chunk, edits, rows)
        kept = ~edits.has_flag("deleted", begin, end)
        if selected_only:
            kept &= edits.has_flag("selected", begin, end)
            kept &= ~(edits.has_flag("hidden", begin, end) | edits.has_flag("locked", begin, end))
        arrays = {name: np.ascontiguousarray(getattr(edited, name)[kept]) for name in ARRAY_NAMES}
        yield SplatChunk(int(kept.sum()), capture.sh_degree, **arrays)
        begin = end


def _with_values(chunk: SplatChunk, edits: CaptureEdits, rows: npt.NDArray[np.int32]) -> SplatChunk:
    """The chunk, whose splats are `rows` of the capture, transformed and painted."""
    changed = {name: edits.values_of(name, rows) for name in VALUES}
    if not any(at.size for at, _ in changed.values()):
        return chunk
    cloud = EditableCloud({name: getattr(chunk, name) for name in ARRAY_NAMES}, choose_device("cpu"))
    for name in ("moved_rows", "painted_rows", "opacity_rows"):
        put_values(cloud, name, *changed[name], edits.matrices)
    return SplatChunk(chunk.splat_count, chunk.sh_degree, **{name: cloud.host(name) for name in ARRAY_NAMES})
