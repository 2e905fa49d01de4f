# SPDX-License-Identifier: GPL-3.0-or-later
"""The rows of one PLY element, in order and block by block, whatever the file's encoding.

| file                                           | read by                                   | memory            |
|------------------------------------------------|-------------------------------------------|-------------------|
| binary, no lists up to the element's end       | two threads, each with a buffer of a block | a few MiB         |
| ascii, no lists in the element                 | lines, parsed in C by `numpy.loadtxt`     | a few MiB         |
| anything else (lists before or in the element) | plyfile, row by row in Python: slow       | the whole element |

Files are read, not mapped: a mapped file that another program cuts short ends the process.
"""

from __future__ import annotations

import io
import os
import queue
import warnings
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from itertools import islice
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
import numpy.typing as npt

from ..errors import StippleError
from .ply_header import PlyElement, PlyHeader, truncated
from .source_file import read_at

# Large, so that two threads rarely wait for the interpreter lock; small against a core's cache and the file, since what
# is read or converted at one time counts as memory. Between 1 and 4 MiB the time differs by less than its noise.
BLOCK_BYTES_MAX = 1 << 21
BLOCK_BYTES_MIN = 1 << 16
BLOCKS_PER_FILE = 32
THREADS = min(2, os.cpu_count() or 1)

Rows = npt.NDArray[np.void]
PutRows = Callable[[int, Rows], None]
Checkpoint = Callable[[int], None]


class RowReader(ABC):
    """Reads the rows of an element once, from the first to the last."""

    @abstractmethod
    def read(self, count: int, put: PutRows, checkpoint: Checkpoint) -> None:
        """Calls `put(index, rows)` until each of the next `count` rows was given once; `index` counts from 0 in them.

        `rows` is a packed structured array of the element's scalar properties, valid only during the call. Calls may
        come in any order and from two threads at once. `checkpoint(rows done)` is called after each block, in the
        caller's thread; what it raises ends the reading. Raises StippleError where rows are missing or malformed.
        """


@contextmanager
def open_rows(file: BinaryIO, path: Path, header: PlyHeader, element: PlyElement) -> Iterator[RowReader]:
    """A reader of `element`'s rows in an open file; `check_size` must have passed."""
    before = header.elements_before(element.name)
    if element.lists or (not header.text and any(other.lists for other in before)):
        yield _PlyfileRows(path, element)
    elif header.text:
        file.seek(header.data_offset)
        wrapper = io.TextIOWrapper(file, encoding="ascii", errors="replace")
        try:
            yield _TextRows(wrapper, path, before, element)
        finally:
            wrapper.detach()  # closing the wrapper would close the caller's file
    else:
        begin = header.data_offset + sum(other.bytes_min for other in before)
        with ThreadPoolExecutor(THREADS) as pool:
            yield _BinaryRows(file, path, begin, element, pool)


def _block_rows(element: PlyElement) -> int:
    row_bytes = element.dtype.itemsize
    block_bytes = min(max(element.count * row_bytes // BLOCKS_PER_FILE, BLOCK_BYTES_MIN), BLOCK_BYTES_MAX)
    return max(1, block_bytes // row_bytes)


class _BinaryRows(RowReader):
    def __init__(self, file: BinaryIO, path: Path, begin: int, element: PlyElement, pool: ThreadPoolExecutor) -> None:
        self._file, self._path, self._element, self._pool = file, path, element, pool
        self._next_byte = begin
        self._block = _block_rows(element)
        self._buffers: queue.SimpleQueue[bytearray] = queue.SimpleQueue()
        for _ in range(THREADS):
            self._buffers.put(bytearray(self._block * element.dtype.itemsize))

    def read(self, count: int, put: PutRows, checkpoint: Checkpoint) -> None:
        begin, row_bytes = self._next_byte, self._element.dtype.itemsize

        def read_block(first: int) -> int:
            rows = min(self._block, count - first)
            buffer = self._buffers.get()
            try:
                target = memoryview(buffer)[: rows * row_bytes]
                if read_at(self._file, begin + first * row_bytes, target) < len(target):  # its size was checked
                    raise StippleError(f"{self._path}: the file changed while it was read; try again.")
                put(first, np.frombuffer(buffer, self._element.dtype, rows))
            finally:
                self._buffers.put(buffer)
            return first + rows

        # Leaving the loop early cancels what has not begun, when the iterator goes.
        for done in self._pool.map(read_block, range(0, count, self._block)):
            checkpoint(done)
        self._next_byte = begin + count * row_bytes


class _TextRows(RowReader):
    def __init__(self, file: io.TextIOWrapper, path: Path, before: tuple[PlyElement, ...], element: PlyElement) -> None:
        self._path, self._element, self._first = path, element, 0
        self._lines = (line for line in file if line.strip())
        for other in before:
            skipped = sum(1 for _ in islice(self._lines, other.count))
            if skipped < other.count:
                raise truncated(path, other, skipped)

    def read(self, count: int, put: PutRows, checkpoint: Checkpoint) -> None:
        block = _block_rows(self._element)
        for first in range(0, count, block):
            wanted = min(block, count - first)
            texts = list(islice(self._lines, wanted))
            if len(texts) < wanted:
                raise truncated(self._path, self._element, self._first + first + len(texts))
            put(first, _parse_lines(texts, self._path, self._element, self._first + first))
            checkpoint(first + wanted)
        self._first += count


class _PlyfileRows(RowReader):
    def __init__(self, path: Path, element: PlyElement) -> None:
        self._element, self._first = element, 0
        self._data = _read_with_plyfile(path, element)

    def read(self, count: int, put: PutRows, checkpoint: Checkpoint) -> None:
        block = _block_rows(self._element)
        for first in range(0, count, block):
            chosen = slice(self._first + first, self._first + min(first + block, count))
            rows = np.empty(chosen.stop - chosen.start, self._element.dtype)
            for name in self._element.dtype.names or ():
                rows[name] = self._data[name][chosen]
            put(first, rows)
            checkpoint(first + len(rows))
        self._first += count


def _parse_lines(texts: list[str], path: Path, element: PlyElement, first: int) -> Rows:
    columns = len(element.dtype.names or ())
    for index, text in enumerate(texts):
        if len(text.split()) != columns:
            raise StippleError(
                f"{path}: row {first + index} of element '{element.name}' has {len(text.split())} values instead of "
                f"{columns}; the file is truncated or damaged, export it again."
            )
    try:
        return np.loadtxt(texts, dtype=element.dtype, comments=None, ndmin=1)
    except ValueError as error:
        raise _malformed(texts, path, element, first) from error


def _malformed(texts: list[str], path: Path, element: PlyElement, first: int) -> StippleError:
    """The error for lines of which one holds a value that is not a number; names the first."""
    what = f"rows {first} to {first + len(texts) - 1} of element '{element.name}' are not all numbers"
    for row, text in enumerate(texts):
        for name, value in zip(element.dtype.names or (), text.split(), strict=True):
            try:
                float(value)
            except ValueError:
                what = (
                    f"row {first + row} of element '{element.name}': property '{name}' is {value[:40]!r}, not a number"
                )
                return StippleError(f"{path}: {what}; the file is damaged, export it again.")
    return StippleError(f"{path}: {what}; the file is damaged, export it again.")


def _read_with_plyfile(path: Path, element: PlyElement) -> Any:
    import plyfile

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # NumPy's, about ascii lists of length 0
            return plyfile.PlyData.read(str(path), mmap="r")[element.name].data
    except Exception as error:  # plyfile raises its own types, ValueError, OverflowError and more
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise StippleError(f"{path}: the file is truncated or damaged ({reason}); copy or export it again.") from error
