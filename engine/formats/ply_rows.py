# SPDX-License-Identifier: GPL-3.0-or-later
"""The rows of one PLY element, block by block, whatever the file's encoding.

| file                                           | read by                                   |
|------------------------------------------------|-------------------------------------------|
| binary, no lists up to the element's end       | small memory maps, two threads            |
| ascii, no lists in the element                 | lines, parsed in C by `numpy.loadtxt`     |
| anything else (lists before or in the element) | plyfile, row by row in Python: slow       |
"""

from __future__ import annotations

import io
import mmap
import os
import warnings
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from itertools import islice
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
import numpy.typing as npt

from ..errors import StippleError
from .ply_header import PlyElement, PlyHeader, truncated

# Large, so that two threads rarely wait for the interpreter lock; small against a core's cache and the file, since what
# is mapped or converted at one time counts as memory. Between 1 and 4 MiB the time differs by less than its noise.
BLOCK_BYTES_MAX = 1 << 21
BLOCK_BYTES_MIN = 1 << 16
BLOCKS_PER_FILE = 32
THREADS = min(2, os.cpu_count() or 1)

Rows = npt.NDArray[np.void]
PutRows = Callable[[int, Rows], None]


def read_rows(file: BinaryIO, path: Path, header: PlyHeader, element: PlyElement, put: PutRows) -> None:
    """Calls `put(index of the first row, rows)` until every row of `element` was given once.

    `rows` is a packed structured array of the element's scalar properties, valid only during the call. Calls come in
    any order and from two threads at once. `check_size` must have passed.

    Raises StippleError where rows are missing or malformed.
    """
    before = header.elements_before(element.name)
    if element.lists or (not header.text and any(other.lists for other in before)):
        _read_with_plyfile(path, element, put)
    elif header.text:
        file.seek(header.data_offset)
        _read_text(file, path, before, element, put)
    else:
        _read_mapped(file, path, header.data_offset + sum(other.bytes_min for other in before), element, put)


def _block_rows(element: PlyElement) -> int:
    row_bytes = element.dtype.itemsize
    block_bytes = min(max(element.count * row_bytes // BLOCKS_PER_FILE, BLOCK_BYTES_MIN), BLOCK_BYTES_MAX)
    return max(1, block_bytes // row_bytes)


def _read_mapped(file: BinaryIO, path: Path, offset: int, element: PlyElement, put: PutRows) -> None:
    """Maps one block at a time and unmaps it again, so that the file's pages never add up in resident memory.

    One map of the whole file with `madvise(MADV_DONTNEED)` would do the same, but Windows has none.
    """
    row_bytes = element.dtype.itemsize
    block = _block_rows(element)

    def read_block(first: int) -> None:
        count = min(block, element.count - first)
        begin = offset + first * row_bytes
        aligned = begin - begin % mmap.ALLOCATIONGRANULARITY
        length = begin - aligned + count * row_bytes
        try:
            mapped = mmap.mmap(file.fileno(), length, access=mmap.ACCESS_READ, offset=aligned)
        except ValueError as error:  # shorter than when its size was checked
            raise StippleError(f"{path}: the file changed while it was read; try again.") from error
        # The view keeps the map alive; both go, and the pages with them, when this call returns.
        put(first, np.frombuffer(mapped, element.dtype, count, begin - aligned))

    with ThreadPoolExecutor(THREADS) as pool:
        for _ in pool.map(read_block, range(0, element.count, block)):
            pass


def _read_text(file: BinaryIO, path: Path, before: tuple[PlyElement, ...], element: PlyElement, put: PutRows) -> None:
    wrapper = io.TextIOWrapper(file, encoding="ascii", errors="replace")
    lines = (line for line in wrapper if line.strip())
    try:
        for other in before:
            skipped = sum(1 for _ in islice(lines, other.count))
            if skipped < other.count:
                raise truncated(path, other, skipped)
        block = _block_rows(element)
        for first in range(0, element.count, block):
            wanted = min(block, element.count - first)
            texts = list(islice(lines, wanted))
            if len(texts) < wanted:
                raise truncated(path, element, first + len(texts))
            put(first, _parse_lines(texts, path, element, first))
    finally:
        wrapper.detach()  # closing the wrapper would close the caller's file


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


def _read_with_plyfile(path: Path, element: PlyElement, put: PutRows) -> None:
    import plyfile

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # NumPy's, about ascii lists of length 0
            data: Any = plyfile.PlyData.read(str(path), mmap="r")[element.name].data
    except Exception as error:  # plyfile raises its own types, ValueError, OverflowError and more
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise StippleError(f"{path}: the file is truncated or damaged ({reason}); copy or export it again.") from error
    block = _block_rows(element)
    for first in range(0, element.count, block):
        rows = np.empty(len(data[first : first + block]), element.dtype)
        for name in element.dtype.names or ():
            rows[name] = data[name][first : first + block]
        put(first, rows)
