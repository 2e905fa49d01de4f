# SPDX-License-Identifier: GPL-3.0-or-later
"""Cache files: the quantised arrays of a large capture, so that its second opening reads nothing else.

| part                     | holds                                                                              |
|--------------------------|------------------------------------------------------------------------------------|
| 64 bytes                 | magic, versions of the format and of the arrays' meaning, place of the directory   |
| arrays, aligned to 4 KiB | little-endian, as they lie on the device                                           |
| directory (JSON)         | the capture's fingerprint, facts; type, shape, place, a CRC-32 per 4 MiB of arrays |

The directory is last and found through the first 64 bytes, so a file that was cut short has none. A cache is used only
if everything about it is as expected: magic, versions, fingerprint, sizes, and each block's CRC while it is read.
Whatever else it is, `CacheUnusable` says why, and the caller makes it anew. Knows neither Warp nor the arrays' meaning.
"""

from __future__ import annotations

import json
import os
import struct
import zlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, BinaryIO

from .capture_fingerprint import Fingerprint
from .formats.atomic_file import replacing
from .formats.source_file import read_at

MAGIC = b"STIPPLE\x1a"
FORMAT_VERSION = 1
PREAMBLE = struct.Struct("<8sIIQQI28x")
ALIGNMENT = 4096
BLOCK_BYTES = 1 << 22
LARGEST_DIRECTORY = 1 << 28
THREADS = min(4, os.cpu_count() or 1)

Facts = Mapping[str, Any]
FetchBytes = Callable[[int, int], "memoryview"]
"""The bytes from the first to before the second of an array; valid until the next call."""


class CacheUnusable(Exception):
    """Why a cache file is not used. `damaged` tells what should have been good from what is merely out of date."""

    def __init__(self, reason: str, *, damaged: bool = True) -> None:
        super().__init__(reason)
        self.damaged = damaged


@dataclass(frozen=True)
class ArrayToStore:
    """`dtype` is its name on the device, such as "vec4ui"; `nbytes` in all; `fetch` gives them piece by piece."""

    dtype: str
    shape: tuple[int, ...]
    nbytes: int
    fetch: FetchBytes


@dataclass(frozen=True)
class StoredArray:
    """Where an array lies in the file, and the CRC-32 of each of its blocks."""

    dtype: str
    shape: tuple[int, ...]
    nbytes: int
    offset: int
    checksums: tuple[int, ...]


def write_cache(
    path: Path,
    fingerprint: Fingerprint,
    meaning: int,
    facts: Facts,
    arrays: Mapping[str, ArrayToStore],
    checkpoint: Callable[[float], None],
) -> None:
    """Writes a cache file in one step; `checkpoint` is called with the fraction done.

    - `meaning`: version of what the arrays hold; `facts`: JSON values that the reader gets back.

    Raises StippleError where the file cannot be written; nothing half-written stays.
    """
    total = max(1, sum(array.nbytes for array in arrays.values()))
    written = 0
    with replacing(path) as file:
        file.write(bytes(ALIGNMENT))
        directory: dict[str, Any] = {"fingerprint": asdict(fingerprint), "facts": dict(facts), "arrays": {}}
        for name, array in arrays.items():
            offset, checksums = file.tell(), []
            for begin, end in blocks_of(array.nbytes):
                piece = array.fetch(begin, end)
                checksums.append(zlib.crc32(piece))
                file.write(piece)
                written += end - begin
                checkpoint(written / total)
            stored = StoredArray(array.dtype, array.shape, array.nbytes, offset, tuple(checksums))
            directory["arrays"][name] = asdict(stored)
            file.write(bytes(-file.tell() % ALIGNMENT))
        text = json.dumps(directory).encode("utf-8")
        begin = file.tell()
        file.write(text)
        file.seek(0)
        file.write(PREAMBLE.pack(MAGIC, FORMAT_VERSION, meaning, begin, len(text), zlib.crc32(text)))


def blocks_of(nbytes: int) -> Iterator[tuple[int, int]]:
    """First byte and byte after the last of each block of an array."""
    for begin in range(0, nbytes, BLOCK_BYTES):
        yield begin, min(begin + BLOCK_BYTES, nbytes)


class CacheReader:
    """An open cache file whose directory has been found good; its arrays are checked while they are read."""

    def __init__(self, file: BinaryIO, facts: Facts, arrays: Mapping[str, StoredArray]) -> None:
        self._file, self.facts, self.arrays = file, facts, arrays

    def read(self, name: str, target: memoryview, checkpoint: Callable[[int], None]) -> None:
        """Fills `target`, as many bytes as the array has; `checkpoint` is told the bytes done.

        Raises CacheUnusable where a block is not what was written.
        """
        blocks = list(blocks_of(self.arrays[name].nbytes))

        def read_one(index: int) -> int:
            begin, end = blocks[index]
            self.read_block(name, index, target[begin:end])
            return end

        with ThreadPoolExecutor(THREADS) as pool:
            for done in pool.map(read_one, range(len(blocks))):
                checkpoint(done)

    def read_block(self, name: str, index: int, target: memoryview) -> None:
        """Fills `target` with block number `index` of an array. May be called from several threads."""
        array = self.arrays[name]
        try:
            filled = read_at(self._file, array.offset + index * BLOCK_BYTES, target)
        except OSError as error:
            raise CacheUnusable(f"{name} cannot be read ({error.strerror})") from error
        if filled != len(target) or zlib.crc32(target) != array.checksums[index]:
            raise CacheUnusable(f"{name} is damaged")


@contextmanager
def open_cache(path: Path, fingerprint: Fingerprint, meaning: int) -> Iterator[CacheReader]:
    """Opens a cache file of the capture that has this fingerprint. Raises CacheUnusable."""
    try:
        file = path.open("rb", buffering=0)
    except OSError as error:
        raise CacheUnusable(error.strerror or str(error), damaged=False) from error
    with file:
        directory = _directory(file, meaning)
        try:
            if directory["fingerprint"] != asdict(fingerprint):
                raise CacheUnusable("it is of another state of the capture", damaged=False)
            arrays = {
                name: StoredArray(**(entry | {key: tuple(entry[key]) for key in ("shape", "checksums")}))
                for name, entry in directory["arrays"].items()
            }
            facts = dict(directory["facts"])
            _check_places(arrays, os.fstat(file.fileno()).st_size)
        except (AttributeError, KeyError, TypeError, ValueError) as error:
            raise CacheUnusable("its directory is not what it should be") from error
        yield CacheReader(file, facts, arrays)


def _directory(file: Any, meaning: int) -> dict[str, Any]:
    try:
        start = bytearray(PREAMBLE.size)
        if read_at(file, 0, memoryview(start)) != PREAMBLE.size:
            raise CacheUnusable("it is cut short")
        magic, version, stored_meaning, begin, length, checksum = PREAMBLE.unpack(start)
        if magic != MAGIC:
            raise CacheUnusable("it is not a cache file of Stipple")
        if (version, stored_meaning) != (FORMAT_VERSION, meaning):
            raise CacheUnusable("another version of Stipple wrote it", damaged=False)
        if length > LARGEST_DIRECTORY or begin + length > os.fstat(file.fileno()).st_size:
            raise CacheUnusable("it is cut short")
        text = bytearray(length)
        if read_at(file, begin, memoryview(text)) != length or zlib.crc32(text) != checksum:
            raise CacheUnusable("its directory is damaged")
        directory = json.loads(text)
    except OSError as error:
        raise CacheUnusable(f"it cannot be read ({error.strerror})") from error
    except ValueError as error:
        raise CacheUnusable("its directory is damaged") from error
    if not isinstance(directory, dict):
        raise CacheUnusable("its directory is not what it should be")
    return directory


def _check_places(arrays: Mapping[str, StoredArray], file_bytes: int) -> None:
    for name, array in arrays.items():
        blocks: Sequence[tuple[int, int]] = list(blocks_of(array.nbytes))
        if array.offset < 0 or array.offset + array.nbytes > file_bytes or len(blocks) != len(array.checksums):
            raise CacheUnusable(f"{name} is not all there")
