# SPDX-License-Identifier: GPL-3.0-or-later
"""The edits of a capture as a file of their own: a NumPy archive (.npz, deflated) that any program can read.

`header` is JSON text: `format` and `version` of this file; `capture`, its `name`, `bytes`, `samples` (the hash of
`capture_fingerprint`), `splats` and `sh_degree`; `token`, the hash of everything. The other arrays are those of
`capture_edits`. Nothing in it depends on the machine or the version of Python, and nothing in it is executed.
"""

from __future__ import annotations

import json
import zipfile
import zlib
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import StippleError
from ..formats.atomic_file import replacing
from ..formats.source_file import open_source
from .capture_edits import DTYPES, CaptureEdits

SUFFIX = ".edits.npz"
MAGIC = b"PK\x03\x04"  # of an archive that holds something
FORMAT, VERSION = "stipple-edits", 1
UNREADABLE = (OSError, EOFError, ValueError, KeyError, TypeError, zipfile.BadZipFile, zlib.error, NotImplementedError)


def write_edits(path: Path, edits: CaptureEdits, name: str, sh_degree: int) -> None:
    """Replaces the file in one step. `name` and `sh_degree` are the capture's, for whoever looks into it.

    Raises StippleError where it cannot be written; what was there stays then.
    """
    size, samples = edits.capture.split()
    capture = {"name": name, "bytes": int(size), "samples": samples, "splats": edits.splat_count}
    capture["sh_degree"] = sh_degree
    header = {"format": FORMAT, "version": VERSION, "capture": capture, "token": edits.token}
    arrays: dict[str, Any] = {"header": np.array(json.dumps(header)), **edits.arrays}
    with replacing(path) as file:
        np.savez_compressed(file, **arrays)


def read_edits(path: Path) -> CaptureEdits:
    """What `write_edits` wrote, every bit checked.

    Raises StippleError, in one sentence, where the file is missing, is none of these, is damaged, or is of a later
    version.
    """
    try:
        with open_source(path) as file:
            if file.read(len(MAGIC)) != MAGIC:  # NumPy would take it for a pickle, and say how to load that
                raise ValueError("it is no NumPy archive")
            file.seek(0)
            with np.load(file, allow_pickle=False) as archive:
                return _edits_of(path, archive)
    except UNREADABLE as error:
        raise StippleError(
            f"{path}: the edits are damaged ({error}); put an undamaged copy in its place, or discard the edits."
        ) from error


def _edits_of(path: Path, archive: Any) -> CaptureEdits:
    header = json.loads(str(_array(archive, "header")[()]))
    if header["format"] != FORMAT:
        raise ValueError("it is not a file of edits")
    if header["version"] != VERSION:
        raise StippleError(f"{path}: another version of Stipple wrote these edits; open them with that version.")
    names = set(archive.files) - {"header"}
    if not names <= DTYPES.keys():
        raise ValueError(f"it holds {', '.join(sorted(names - DTYPES.keys()))}")
    capture = header["capture"]
    try:
        edits = CaptureEdits(
            f"{int(capture['bytes'])} {capture['samples']}",
            int(capture["splats"]),
            {n: _array(archive, n) for n in names},
        )
    except StippleError as error:
        raise ValueError(str(error)) from error
    if edits.token != header["token"]:
        raise ValueError("its checksum does not fit")
    return edits


def _array(archive: Any, name: str) -> Any:
    """An array of the archive, none of Python's objects, nor a file that is no array."""
    try:
        array = archive[name]
    except ValueError as error:  # with advice on pickles
        raise ValueError(f"its array {name!r} cannot be read") from error
    if not isinstance(array, np.ndarray):
        raise ValueError(f"its {name!r} is no array")
    return array
