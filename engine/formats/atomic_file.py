# SPDX-License-Identifier: GPL-3.0-or-later
"""Replacing a file in one step, so that a reader sees the old one or the new one and never half of it; or several."""

from __future__ import annotations

import os
import secrets
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, suppress
from pathlib import Path
from typing import BinaryIO

from ..errors import StippleError

Place = Callable[[Path], AbstractContextManager[BinaryIO]]
"""`replacing`, or what stands in for it while several files are written."""


@contextmanager
def replacing(path: Path) -> Iterator[BinaryIO]:
    """A new file to write into; it takes `path`'s place when the block ends and vanishes when the block raises.

    The temporary file lies in the same folder, since only there is `os.replace` one step; a symbolic link stays and
    what it points to is replaced. The data is not forced to the disk: a power cut may still lose it.
    Raises StippleError where the folder is missing, is not writable or is full, or `path` is a folder.
    """
    with replacing_together() as place, place(path) as file:
        yield file


@contextmanager
def replacing_together() -> Iterator[Place]:
    """As `replacing`, for several files: none takes its place before all of them are written.

    Gives what stands in for `replacing`. When the block raises, all of them vanish. The moves at its end are one step
    each: where the system refuses one of those, which a full disk or a missing folder no longer can, those before it
    are done.
    """
    moves: list[tuple[Path, Path, Path]] = []  # as it was asked for, the temporary file, what it takes the place of

    @contextmanager
    def beside(path: Path) -> Iterator[BinaryIO]:
        target = Path(os.path.realpath(path))
        if target.is_dir():
            raise StippleError(f"{path}: this is a folder; give the name of a file.")
        if not target.parent.is_dir():
            raise StippleError(f"{path}: the folder {target.parent} does not exist; make it first.")
        # Not tempfile: its files can be read by their owner only, and the mode would stay.
        temporary = target.with_name(f".{target.name[:100]}.{secrets.token_hex(6)}.tmp")
        moves.append((path, temporary, target))
        with _explained(path), temporary.open("xb") as file:
            yield file

    try:
        yield beside
        for path, temporary, target in moves:
            with _explained(path):
                os.replace(temporary, target)
    finally:
        for _, temporary, _ in moves:
            with suppress(OSError):
                temporary.unlink(missing_ok=True)


@contextmanager
def _explained(path: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        reason = error.strerror or str(error)
        raise StippleError(f"{path}: it cannot be written ({reason}); choose another folder or make room.") from error
