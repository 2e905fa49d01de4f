# SPDX-License-Identifier: GPL-3.0-or-later
"""COLMAP's `cameras.bin` and `images.bin`: little-endian, packed, records behind a uint64 count."""

from __future__ import annotations

import os
import struct
from pathlib import Path
from typing import Any

from .colmap_model import CAMERA_MODELS, CameraRecord, ImageRecord, record_error
from .source_file import open_source

POINT_BYTES = 24  # x, y: float64; POINT3D_ID: uint64
NAME_BYTES_MAX = 4096  # a longer name means that the file is damaged


def read_cameras(path: Path) -> dict[int, CameraRecord]:
    """Lenses by camera id: uint32 id, int32 model, uint64 width and height, float64 parameters.

    Raises StippleError naming the file and the record, also for a model that COLMAP added later: how long its record
    is cannot be known.
    """
    cameras: dict[int, CameraRecord] = {}
    with _Records(path, "camera") as records:
        for _ in range(records.count):
            where = records.next()
            camera_id, model_id, width, height = records.take("<IiQQ")
            if not 0 <= model_id < len(CAMERA_MODELS):
                problem = f"camera model {model_id} is not known; undistort the images to PINHOLE first"
                raise record_error(path, where, problem)
            model, parameter_count = CAMERA_MODELS[model_id]
            cameras[camera_id] = CameraRecord(model, width, height, records.take(f"<{parameter_count}d"), where)
        records.check_end()
    return cameras


def read_images(path: Path) -> list[ImageRecord]:
    """Views in the file's order: uint32 id, 7 float64 (quaternion, translation), uint32 camera id, name, points.

    Points are skipped. Raises StippleError naming the file and the record.
    """
    images: list[ImageRecord] = []
    with _Records(path, "image") as records:
        for _ in range(records.count):
            where = records.next()
            _, *pose, camera_id = records.take("<I7dI")
            name = records.name()
            records.skip(POINT_BYTES * records.take("<Q")[0])
            images.append(ImageRecord(name, tuple(pose[:4]), tuple(pose[4:]), camera_id, where))
        records.check_end()
    return images


class _Records:
    """A file read record by record; everything that passes its end becomes one sentence."""

    def __init__(self, path: Path, kind: str) -> None:
        self._path, self._kind, self._number = path, kind, 0
        self._file = open_source(path)
        self._size = os.fstat(self._file.fileno()).st_size
        self.count = 0

    def __enter__(self) -> _Records:
        try:
            self.count = self.take("<Q")[0]
        except BaseException:
            self._file.close()
            raise
        return self

    def __exit__(self, *exception: object) -> None:
        self._file.close()

    @property
    def _where(self) -> str:
        return f"{self._kind} {self._number} of {self.count}" if self._number else "the number of records"

    def next(self) -> str:
        """Goes on to the next record and says which it is, counted from 1."""
        self._number += 1
        return self._where

    def take(self, layout: str) -> tuple[Any, ...]:
        data = self._file.read(struct.calcsize(layout))
        if len(data) < struct.calcsize(layout):
            raise self._truncated()
        return struct.unpack(layout, data)

    def skip(self, byte_count: int) -> None:
        if byte_count > self._size - self._file.tell():
            raise self._truncated()
        self._file.seek(byte_count, os.SEEK_CUR)

    def name(self) -> str:
        """Text up to a zero byte."""
        start = self._file.tell()
        text, zero, _ = self._file.read(NAME_BYTES_MAX).partition(b"\0")
        if not zero:
            raise self._truncated()
        self._file.seek(start + len(text) + 1)
        try:
            return text.decode("utf-8")
        except UnicodeDecodeError:
            raise record_error(self._path, self._where, "its name is not UTF-8 text; export the model again") from None

    def check_end(self) -> None:
        """Refuses a file that goes on behind its last record: then it is something else."""
        left = self._size - self._file.tell()
        if left:
            problem = f"{left} bytes follow the last {self._kind}; this is no COLMAP file, or a damaged one"
            raise record_error(self._path, self._where, problem)

    def _truncated(self) -> Exception:
        return record_error(self._path, self._where, "the file ends inside it; copy or export the model again")
