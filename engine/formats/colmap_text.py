# SPDX-License-Identifier: GPL-3.0-or-later
"""COLMAP's `cameras.txt` and `images.txt`."""

from __future__ import annotations

from codecs import BOM_UTF8
from collections.abc import Iterator
from pathlib import Path

from .colmap_model import PARAMETER_COUNT, CameraRecord, ImageRecord, record_error
from .source_file import open_source


def read_cameras(path: Path) -> dict[int, CameraRecord]:
    """Lenses by camera id: lines `CAMERA_ID MODEL WIDTH HEIGHT PARAMS…`.

    Models that COLMAP may add later are kept as they stand. Raises StippleError naming the file and the line.
    """
    cameras: dict[int, CameraRecord] = {}
    for number, line in _lines(path):
        if _is_remark(line):
            continue
        where = f"line {number}"
        words = _decoded(path, where, line).split()
        try:
            camera_id, model, width, height = int(words[0]), words[1], int(words[2]), int(words[3])
            parameters = tuple(map(float, words[4:]))
        except (ValueError, IndexError):
            raise record_error(path, where, "a camera is CAMERA_ID MODEL WIDTH HEIGHT PARAMS; correct it") from None
        expected = PARAMETER_COUNT.get(model, len(parameters))
        if len(parameters) != expected:
            problem = f"{model} has {len(parameters)} parameters where {expected} are needed; export the model again"
            raise record_error(path, where, problem)
        cameras[camera_id] = CameraRecord(model, width, height, parameters, where)
    return cameras


def read_images(path: Path) -> list[ImageRecord]:
    """Views in the file's order: `IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME`, each followed by a line of points.

    The points `X Y POINT3D_ID …` are not used, but a line that holds anything else is refused: it would mean that
    every second view is skipped. A name may hold spaces. Raises StippleError naming the file and the line.
    """
    images: list[ImageRecord] = []
    points_follow = False
    for number, line in _lines(path):
        where = f"line {number}"
        if points_follow:
            _check_points(path, where, line)
            points_follow = False
        elif not _is_remark(line):
            images.append(_image(path, where, _decoded(path, where, line)))
            points_follow = True
    return images


def _image(path: Path, where: str, line: str) -> ImageRecord:
    words = line.split(maxsplit=9)
    try:
        numbers = tuple(map(float, words[1:8]))
        return ImageRecord(words[9].strip(), numbers[:4], numbers[4:], int(words[8]), where)
    except (ValueError, IndexError):
        problem = "an image is IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME; correct it or export the model again"
        raise record_error(path, where, problem) from None


def _check_points(path: Path, where: str, line: bytes) -> None:
    words = line.split()
    last_is_id = not words or words[-1].lstrip(b"-").isdigit()
    if len(words) % 3 or not last_is_id:
        problem = "points are X Y POINT3D_ID each; put an empty line after every image that has none"
        raise record_error(path, where, problem)


def _lines(path: Path) -> Iterator[tuple[int, bytes]]:
    with open_source(path) as file:
        for number, line in enumerate(file, start=1):
            yield number, line.removeprefix(BOM_UTF8) if number == 1 else line  # some editors write one


def _is_remark(line: bytes) -> bool:
    return not line.strip() or line.lstrip().startswith(b"#")


def _decoded(path: Path, where: str, line: bytes) -> str:
    try:
        return line.decode("utf-8")
    except UnicodeDecodeError:
        raise record_error(path, where, "it is not UTF-8 text; export the model again as text") from None
