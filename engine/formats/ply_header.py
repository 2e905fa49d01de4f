# SPDX-License-Identifier: GPL-3.0-or-later
"""The header of a PLY file: which elements it has, how their rows are stored, and whether the file can hold them.

plyfile parses the header. It is given a copy in which every count is zero, so that it parses the header and nothing
else: it would otherwise allocate whatever count the header claims (ascii files, lists) before reading a row.
"""

from __future__ import annotations

import io
import re
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from ..errors import StippleError

HEADER_BYTES_MAX = 1 << 20  # 72 f_rest properties need 2 KB; the rest is room for comments
NEWLINES = (b"\r\n", b"\n", b"\r")  # in this order: "\r\n" begins with "\r"


@dataclass(frozen=True)
class PlyElement:
    """One element: `count` rows of the scalar properties in `dtype` and of the list properties named in `lists`.

    `dtype` is packed and in the file's byte order: the row's layout in the file where the file is binary and there
    are no lists. For ascii it is all float64, which holds what any PLY type can, so `3.0` will do for an integer.
    `row_bytes_min` is the least that a row takes in the file [bytes].
    """

    name: str
    count: int
    dtype: np.dtype[np.void]
    lists: frozenset[str]
    row_bytes_min: int

    @property
    def bytes_min(self) -> int:
        return self.count * self.row_bytes_min


@dataclass(frozen=True)
class PlyHeader:
    """Elements in the file's order; `data_offset` is where the first one's rows begin [bytes]."""

    elements: tuple[PlyElement, ...]
    text: bool
    data_offset: int

    def element(self, name: str) -> PlyElement | None:
        return next((element for element in self.elements if element.name == name), None)

    def elements_before(self, name: str) -> tuple[PlyElement, ...]:
        return self.elements[: [element.name for element in self.elements].index(name)]


def starts_like_ply(beginning: bytes) -> bool:
    """Whether a file that begins with these bytes calls itself a PLY file."""
    return beginning[:4] in (b"ply\n", b"ply\r")


def read_header(file: BinaryIO, path: Path) -> PlyHeader:
    """Parses the header of an open file; `check_size` says whether the rows it promises can be there.

    Raises StippleError where the file is not a PLY file or its header is damaged.
    """
    beginning = file.read(HEADER_BYTES_MAX)
    if not starts_like_ply(beginning):
        raise StippleError(f"{path}: this is not a PLY file (it does not begin with 'ply'); choose a 3DGS .ply file.")
    newline = next(newline for newline in NEWLINES if beginning.startswith(newline, 3))
    last_line = re.search(newline + rb"end_header[ \t]*" + newline, beginning)
    if last_line is None:
        raise StippleError(f"{path}: the PLY header has no line 'end_header'; the file is damaged, export it again.")
    lines, counts = _without_counts(beginning[: last_line.start()].split(newline), path)
    parsed = _parse(b"\n".join([*lines, b"end_header", b""]), path)
    elements = tuple(
        _element(element, count, parsed.text, parsed.byte_order)
        for element, count in zip(parsed.elements, counts, strict=True)
    )
    return PlyHeader(elements, parsed.text, last_line.end())


def check_size(header: PlyHeader, file_bytes: int, path: Path) -> None:
    """Raises StippleError where the file is too short for the rows that its header promises.

    Exact for binary elements without lists; a lower bound for ascii and for lists, which the row readers complete.
    """
    left = file_bytes - header.data_offset + header.text  # the last line of a text may lack its newline
    for element in header.elements:
        if element.bytes_min > left:
            complete = left // element.row_bytes_min
            raise truncated(path, element, complete)
        left -= element.bytes_min


def truncated(path: Path, element: PlyElement, complete: int) -> StippleError:
    """The error for a file that ends after `complete` of an element's rows."""
    return StippleError(
        f"{path}: the file is truncated: the header promises {element.count:,} rows of element '{element.name}', "
        f"there is room for {complete:,}; copy or export it again."
    )


def _without_counts(lines: list[bytes], path: Path) -> tuple[list[bytes], list[int]]:
    """The header with every count set to 0 and comments emptied (plyfile accepts ASCII only), and the counts."""
    kept: list[bytes] = []
    counts: list[int] = []
    for line in lines:
        fields = line.split()
        if not fields or fields[0] in (b"comment", b"obj_info"):
            kept.append(b"comment")  # not left out: plyfile counts lines in its messages
        elif fields[:1] == [b"element"] and len(fields) == 3 and fields[2].isdigit() and len(fields[2]) < 20:
            counts.append(int(fields[2]))
            kept.append(b"element " + fields[1] + b" 0")
        elif fields[:1] == [b"element"]:
            shown = line.strip().decode("ascii", "replace")[:80]
            raise StippleError(f"{path}: the PLY header line {shown!r} has no valid count; export the file again.")
        else:
            kept.append(line)
    _refuse_duplicates(kept, path)
    return kept, counts


def _refuse_duplicates(lines: list[bytes], path: Path) -> None:
    """Raises StippleError where an element has two properties of one name (plyfile's message does not say which)."""
    seen: Counter[bytes] = Counter()
    for fields in map(bytes.split, lines):
        if fields[:1] == [b"element"]:
            seen.clear()
        elif fields[:1] == [b"property"]:
            seen[fields[-1]] += 1
            if seen[fields[-1]] > 1:
                name = fields[-1].decode("ascii", "replace")
                raise StippleError(f"{path}: the property '{name}' is there twice; export the file again with one.")


def _parse(header: bytes, path: Path) -> Any:
    """plyfile's PlyData of a header whose counts are all 0."""
    import plyfile

    try:
        return plyfile.PlyData.read(io.BytesIO(header))
    except Exception as error:  # plyfile raises its own types, ValueError, UnicodeDecodeError and more
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise StippleError(f"{path}: the PLY header is not valid ({reason}); export the file again.") from error


def _element(parsed: Any, count: int, text: bool, byte_order: str) -> PlyElement:
    import plyfile

    lists = [prop for prop in parsed.properties if isinstance(prop, plyfile.PlyListProperty)]
    scalars = [prop for prop in parsed.properties if prop not in lists]
    dtype = np.dtype([(prop.name, "=f8" if text else prop.dtype(byte_order)) for prop in scalars])
    if text:
        row_bytes_min = max(1, 2 * len(parsed.properties))  # a digit and a blank or newline each
    else:
        row_bytes_min = dtype.itemsize + sum(np.dtype(prop.list_dtype(byte_order)[0]).itemsize for prop in lists)
    return PlyElement(parsed.name, count, dtype, frozenset(prop.name for prop in lists), row_bytes_min)
