# SPDX-License-Identifier: GPL-3.0-or-later
"""Opening a file to read, with one clear sentence for everything that can be wrong before its first byte; reading."""

from __future__ import annotations

import os
import stat
import threading
from pathlib import Path
from typing import BinaryIO

from ..errors import StippleError


def open_source(path: Path) -> BinaryIO:
    """Opens a regular, non-empty file for reading bytes.

    Raises StippleError for a missing file, a folder, a pipe or device (opening those could wait for ever), a file
    without read permission, an empty file.
    """
    try:
        status = path.stat()
        if stat.S_ISDIR(status.st_mode):
            raise StippleError(f"{path}: this is a folder; choose a file.")
        if not stat.S_ISREG(status.st_mode):
            raise StippleError(f"{path}: this is not a regular file; choose a file on a disk.")
        if status.st_size == 0:
            raise StippleError(f"{path}: the file is empty (0 bytes); copy or export it again.")
        return path.open("rb")
    except FileNotFoundError as error:
        raise StippleError(f"{path}: there is no such file; check the path.") from error
    except PermissionError as error:
        raise StippleError(f"{path}: there is no permission to read it; change the file's permissions.") from error
    except (OSError, ValueError) as error:  # ValueError: a path with a zero byte
        raise StippleError(f"{path}: it cannot be opened ({error}); check the path.") from error


_seeking = threading.Lock()


def read_at(file: BinaryIO, offset: int, target: memoryview) -> int:
    """Fills `target` with the bytes from `offset` on; returns how many there were, fewer only at the file's end.

    Several threads may read one file at once. Lets OSError through.
    """
    filled = 0
    while filled < len(target):
        if hasattr(os, "preadv"):
            count = os.preadv(file.fileno(), [target[filled:]], offset + filled)
        else:  # Windows
            with _seeking:
                file.seek(offset + filled)
                count = file.readinto(target[filled:])  # type: ignore[attr-defined]
        if not count:
            break
        filled += count
    return filled
