# SPDX-License-Identifier: GPL-3.0-or-later
"""Width and height of a PNG or JPEG file, from its first bytes: neither Pillow nor Blender is needed for that."""

from __future__ import annotations

import os
import struct
from pathlib import Path
from typing import BinaryIO

from ..errors import StippleError
from .source_file import open_source

PNG = b"\x89PNG\r\n\x1a\n"
JPEG = b"\xff\xd8"
FRAMES = {*range(0xC0, 0xD0)} - {0xC4, 0xC8, 0xCC}  # JPEG's segments that hold the size, by their second byte
FILLER = 0xFF


def size_of_image(path: Path) -> tuple[int, int]:
    """(width, height) [px] as stored. Raises StippleError for a file that cannot be read or is of another kind."""
    with open_source(path) as file:
        start = file.read(24)
        try:
            if start.startswith(PNG):
                width, height = struct.unpack(">2I", start[16:24])
                return width, height
            if start.startswith(JPEG):
                return _size_of_jpeg(file)
        except struct.error:
            raise StippleError(f"{path}: the image is damaged; copy it again.") from None
    raise StippleError(f"{path}: its size is not known, for it is neither PNG nor JPEG; convert it to one of them.")


def _size_of_jpeg(file: BinaryIO) -> tuple[int, int]:
    """Raises struct.error where the segments end without a frame or make no sense."""
    file.seek(len(JPEG))
    while True:
        mark, kind = struct.unpack(">2B", file.read(2))
        if kind == FILLER:
            file.seek(-1, os.SEEK_CUR)
            continue
        (length,) = struct.unpack(">H", file.read(2))
        if mark != FILLER or length < 2:
            raise struct.error
        if kind in FRAMES:
            height, width = struct.unpack(">x2H", file.read(5))
            return width, height
        file.seek(length - 2, os.SEEK_CUR)
