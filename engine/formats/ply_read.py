# SPDX-License-Identifier: GPL-3.0-or-later
"""Reading 3DGS captures from PLY files in chunks: activated in place, unusable splats left out."""

from __future__ import annotations

import os
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import BinaryIO

import numpy as np
import numpy.typing as npt

from ..errors import StippleError
from ..progress import Progress
from ..splats import ARRAY_NAMES, FloatArray, SplatChunk, sh_degree_of_rest_count
from .ply_convert import BadRows, RowConverter
from .ply_header import PlyElement, PlyHeader, check_size, read_header, starts_like_ply
from .ply_layout import splat_element
from .ply_rows import Checkpoint, RowReader, Rows, open_rows
from .source_file import open_source
from .splat_format import AnyPath
from .splat_source import Dropped, SplatSource, chunk_splats_of_degree

__all__ = ["open_ply", "starts_like_ply"]

COMPACT_ROWS = 1 << 16


def open_ply(path: AnyPath) -> SplatSource:
    """Opens a 3DGS capture in a PLY file (ascii, binary little- or big-endian).

    Properties may have any order and any scalar type; normals and other properties and elements are ignored.
    scale = exp(scale_*), opacity = sigmoid(opacity), rotation = rot_* / |rot_*| (rot_0 is w), SH coefficients raw;
    all float32, so positions given as doubles lose what float32 cannot hold. A splat with a NaN or infinite value
    (before or after activation) or a quaternion of length zero is left out; warnings say which properties were bad.

    Memory is bounded for all but files with lists among or before the splats (`ply_rows`). Raises StippleError for a
    file that cannot be opened, is not a splat PLY, or is too short for what its header promises.
    """
    path = Path(path)
    with open_source(path) as file:
        header = read_header(file, path)
        element, rest_count = splat_element(header, path)
        check_size(header, os.fstat(file.fileno()).st_size, path)
        return PlySource(path, header, element, rest_count, _state_of(file))


def _state_of(file: BinaryIO) -> tuple[int, int]:
    """What changes when a file is written to: its size [bytes] and its date [ns]."""
    status = os.fstat(file.fileno())
    return status.st_size, status.st_mtime_ns


class PlySource(SplatSource):
    """A PLY file that holds splats in `element`."""

    def __init__(
        self, path: Path, header: PlyHeader, element: PlyElement, rest_count: int, state: tuple[int, int]
    ) -> None:
        super().__init__(path, element.count, sh_degree_of_rest_count(rest_count))
        self._header, self._element, self._state = header, element, state
        self._converter = RowConverter(rest_count, element.dtype)

    def chunks(
        self,
        arrays: Collection[str] = ARRAY_NAMES,
        *,
        chunk_splats: int | None = None,
        progress: Progress | None = None,
        dropped: Dropped | None = None,
    ) -> Iterator[SplatChunk]:
        dropped = Dropped() if dropped is None else dropped
        size, kept, total = chunk_splats or chunk_splats_of_degree(self.sh_degree), 0, self.splat_count
        with open_source(self.path) as file:
            if _state_of(file) != self._state:
                raise StippleError(f"{self.path}: the file changed after it was opened; try again.")
            with open_rows(file, self.path, self._header, self._element) as reader:
                for first in range(0, total, size):

                    def checkpoint(done: int, first: int = first) -> None:
                        if progress is not None:
                            progress((first + done) / total, f"reading {self.name}")

                    chunk = self._read_chunk(reader, min(size, total - first), arrays, checkpoint, dropped)
                    kept += chunk.splat_count
                    if first + size >= total and not kept:
                        raise StippleError(
                            f"{self.path}: all of its {total:,} splats are unusable: {dropped}; export it again."
                        )
                    yield chunk

    def _read_chunk(
        self, reader: RowReader, count: int, arrays: Collection[str], checkpoint: Checkpoint, dropped: Dropped
    ) -> SplatChunk:
        bad: list[BadRows] = []
        try:
            targets = {
                name: np.empty((count, len(columns)), np.float32)
                for name, columns in self._converter.properties.items()
                if name in arrays
            }

            def put(first: int, rows: Rows) -> None:
                block = {name: target[first : first + len(rows)] for name, target in targets.items()}
                found = self._converter.convert(rows, block)
                if found is not None:
                    bad.append((first + found[0], found[1]))

            reader.read(count, put, checkpoint)
        except MemoryError as error:
            raise StippleError(f"{self.path}: there is too little memory for {count:,} splats; free some.") from error
        except OSError as error:
            raise StippleError(f"{self.path}: it cannot be read ({error.strerror}); copy it again.") from error
        return self._without_bad(targets, count, bad, dropped)

    def _without_bad(
        self, targets: dict[str, FloatArray], count: int, bad: list[BadRows], dropped: Dropped
    ) -> SplatChunk:
        if bad:
            keep = np.ones(count, np.bool_)
            for rows, reasons in sorted(bad, key=lambda found: int(found[0][0])):  # threads finish in any order
                keep[rows] = False
                dropped.reasons.update(reasons)
            kept = int(keep.sum())
            dropped.count += count - kept
            targets, count = {name: _compact(array, keep) for name, array in targets.items()}, kept
        columns = {name: len(columns) for name, columns in self._converter.properties.items()}
        shaped = {name: targets.get(name, np.empty((0, columns[name]), np.float32)) for name in ARRAY_NAMES}
        shaped["opacity"] = shaped["opacity"][:, 0]
        shaped["sh_rest"] = shaped["sh_rest"].reshape(len(shaped["sh_rest"]), columns["sh_rest"] // 3, 3)
        return SplatChunk(splat_count=count, sh_degree=self.sh_degree, **shaped)


def _compact(array: FloatArray, keep: npt.NDArray[np.bool_]) -> FloatArray:
    """Moves the kept rows to the front, in place: a copy of a large cloud would double the peak memory."""
    end = 0
    for first in range(0, len(array), COMPACT_ROWS):
        rows = array[first : first + COMPACT_ROWS][keep[first : first + COMPACT_ROWS]]
        array[end : end + len(rows)] = rows
        end += len(rows)
    return array[:end]
