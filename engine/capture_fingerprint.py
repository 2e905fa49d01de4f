# SPDX-License-Identifier: GPL-3.0-or-later
"""What tells one state of a file from another: size, date and a hash of samples of its content."""

from __future__ import annotations

import hashlib
import os
from dataclasses import dataclass
from pathlib import Path

from .errors import StippleError
from .formats.source_file import open_source, read_at

SAMPLES = 64
SAMPLE_BYTES = 1 << 16


@dataclass(frozen=True)
class Fingerprint:
    """State of a file.

    `samples` is a BLAKE2b hash of 64 KiB at each of 64 even steps, the file's beginning and end among them (up to
    4 MiB: the whole file). It does not see a change between the samples that leaves size and date alone, which takes
    intent; hashing the whole of a large file would cost what a cache saves.
    """

    file_bytes: int
    modified_ns: int
    samples: str


def fingerprint_of(path: Path) -> Fingerprint:
    """Reads at most 4 MiB. Raises StippleError where the file cannot be opened or read."""
    with open_source(path) as file:
        status = os.fstat(file.fileno())
        digest = hashlib.blake2b(digest_size=16)
        buffer = bytearray(SAMPLE_BYTES)
        last = max(0, status.st_size - SAMPLE_BYTES)
        try:
            for offset in dict.fromkeys(last * step // (SAMPLES - 1) for step in range(SAMPLES)):
                digest.update(memoryview(buffer)[: read_at(file, offset, memoryview(buffer))])
        except OSError as error:
            raise StippleError(f"{path}: it cannot be read ({error.strerror}); copy it again.") from error
    return Fingerprint(status.st_size, status.st_mtime_ns, digest.hexdigest())


def has_changed(path: Path, fingerprint: Fingerprint) -> bool:
    """Whether size or date differ, or the file cannot be seen; reads nothing."""
    try:
        status = path.stat()
    except OSError:
        return True
    return (status.st_size, status.st_mtime_ns) != (fingerprint.file_bytes, fingerprint.modified_ns)
