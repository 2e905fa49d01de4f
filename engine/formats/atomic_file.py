# SPDX-License-Identifier: GPL-3.0-or-later
"""Replacing a file in one step, so that a reader sees the old one or the new one and never half of it."""

from __future__ import annotations

import os
import secrets
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import BinaryIO

from ..errors import StippleError


@contextmanager
def replacing(path: Path) -> Iterator[BinaryIO]:
    """A new file to write into; it takes `path`'s place when the block ends and vanishes when the block raises.

    The temporary file lies in the same folder, since only there is `os.replace` one step; a symbolic link stays and
    what it points to is replaced. The data is not forced to the disk: a power cut may still lose it.
    Raises StippleError where the folder is missing, is not writable or is full, or `path` is a folder.
    """
    target = Path(os.path.realpath(path))
    if target.is_dir():
        raise StippleError(f"{path}: this is a folder; give the name of a file.")
    if not target.parent.is_dir():
        raise StippleError(f"{path}: the folder {target.parent} does not exist; make it first.")
    # Not tempfile: its files can be read by their owner only, and the mode would stay.
    temporary = target.with_name(f".{target.name[:100]}.{secrets.token_hex(6)}.tmp")
    try:
        with temporary.open("xb") as file:
            yield file
        os.replace(temporary, target)
    except OSError as error:
        reason = error.strerror or str(error)
        raise StippleError(f"{path}: it cannot be written ({reason}); choose another folder or make room.") from error
    finally:
        with suppress(OSError):
            temporary.unlink(missing_ok=True)
