# SPDX-License-Identifier: GPL-3.0-or-later
"""What a COLMAP sparse model says about cameras: its records, and the numbers of parameters of its camera models.

Text (`colmap_text`) and binary (`colmap_binary`) files hold the same records; `cameras_colmap` makes cameras of them.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from ..errors import StippleError

# Name and number of parameters; the place in the list is the number that stands for the model in binary files.
CAMERA_MODELS = (
    ("SIMPLE_PINHOLE", 3),
    ("PINHOLE", 4),
    ("SIMPLE_RADIAL", 4),
    ("RADIAL", 5),
    ("OPENCV", 8),
    ("OPENCV_FISHEYE", 8),
    ("FULL_OPENCV", 12),
    ("FOV", 5),
    ("SIMPLE_RADIAL_FISHEYE", 4),
    ("RADIAL_FISHEYE", 5),
    ("THIN_PRISM_FISHEYE", 12),
    ("RAD_TAN_THIN_PRISM_FISHEYE", 16),
    ("SIMPLE_DIVISION", 4),
    ("DIVISION", 5),
    ("SIMPLE_FISHEYE", 3),
    ("FISHEYE", 4),
    ("EUCM", 6),
    ("EQUIRECTANGULAR", 2),
)
PARAMETER_COUNT = dict(CAMERA_MODELS)


@dataclass(frozen=True)
class CameraRecord:
    """A lens: `parameters` in COLMAP's order, lengths in pixels; `where` is its place in the file."""

    model: str
    width: int
    height: int
    parameters: tuple[float, ...]
    where: str


@dataclass(frozen=True)
class ImageRecord:
    """A view: camera-from-world `quaternion` (w, x, y, z) as stored and `translation`; `where` as above."""

    name: str
    quaternion: tuple[float, ...]
    translation: tuple[float, ...]
    camera_id: int
    where: str


def record_error(path: Path, where: str, problem: str) -> StippleError:
    """One sentence that names the file, the record and the problem (which says what to do)."""
    return StippleError(f"{path}: {where}: {problem}.")
