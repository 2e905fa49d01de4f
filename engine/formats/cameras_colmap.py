# SPDX-License-Identifier: GPL-3.0-or-later
"""COLMAP's sparse models, text and binary: a folder with `cameras` and `images`."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import numpy.typing as npt

from ..camera import INRIA_NEAR, Camera
from ..errors import StippleError
from . import colmap_binary, colmap_text
from .cameras_entry import Entry
from .colmap_model import CameraRecord, ImageRecord, record_error

READERS = {".bin": colmap_binary, ".txt": colmap_text}  # binary first, as COLMAP itself prefers it
STEMS = ("cameras", "images")
MODEL_FOLDERS = (".", "0", "sparse/0", "sparse")  # where a model lies in the folder that was given
ONE_FOCAL_LENGTH = ("SIMPLE_PINHOLE", "SIMPLE_RADIAL", "RADIAL")  # f, cx, cy, distortion…
TWO_FOCAL_LENGTHS = ("PINHOLE", "OPENCV", "FULL_OPENCV")  # fx, fy, cx, cy, distortion…


def is_model(path: Path) -> bool:
    """Whether a path means a COLMAP model: a folder, or one of the files of a model by its name."""
    return path.is_dir() or (path.stem in STEMS and path.suffix in READERS)


def parse(path: Path) -> tuple[Path, list[Entry]]:
    """The folder in which the model lies and its views, sorted by the names of the images.

    `path` is that folder, a folder above it (`sparse/0` or `sparse` in it) or one of the model's files, whose suffix
    then says whether text or binary is read. Poses are camera-from-world and pixel coordinates have the first pixel's
    centre at (0.5, 0.5): both as here. Quaternions are normalised, as COLMAP does. The principal point is the file's,
    although INRIA's trainer takes the centre. Splats nearer than 0.2 world units are not shown, as in that trainer.

    Lens distortion is left out with a warning. Fisheye and unknown models are refused, for no pinhole picture
    resembles them. Raises StippleError naming the file and the record.
    """
    folder, suffix = _find(path)
    cameras_path, images_path = (folder / f"{stem}{suffix}" for stem in STEMS)
    cameras = READERS[suffix].read_cameras(cameras_path)
    entries = []
    for image in READERS[suffix].read_images(images_path):
        record = cameras.get(image.camera_id)
        if record is None:
            problem = f"{image.name} wants camera {image.camera_id}, which {cameras_path.name} has not; add it"
            raise record_error(images_path, image.where, problem)
        entries.append(_entry(cameras_path, record, images_path, image))
    return folder, sorted(entries, key=lambda entry: entry.name)


def _find(path: Path) -> tuple[Path, str]:
    if not path.is_dir():
        return path.parent, path.suffix
    for folder in (path / name for name in MODEL_FOLDERS):
        for suffix in READERS:
            if all((folder / f"{stem}{suffix}").is_file() for stem in STEMS):
                return folder, suffix
    raise StippleError(
        f"{path}: there is no COLMAP model in this folder (cameras.bin and images.bin, or both as .txt); "
        f"choose a folder that has one, such as sparse/0, or a .json camera file."
    )


def _entry(cameras_path: Path, record: CameraRecord, images_path: Path, image: ImageRecord) -> Entry:
    fx, fy, cx, cy, *distortion = _intrinsics(cameras_path, record)
    camera_from_world = _camera_from_world(images_path, image)
    try:
        camera = Camera(camera_from_world, record.width, record.height, fx, fy, cx, cy, near=INRIA_NEAR)
    except StippleError as error:
        raise StippleError(f"{cameras_path}: {record.where}: {error}") from error
    if not any(distortion):
        return Entry(camera, image.name)
    warning = f"{cameras_path}: lens distortion is ignored; the picture is that of an ideal pinhole camera."
    return Entry(camera, image.name, (warning,))


def _intrinsics(path: Path, record: CameraRecord) -> tuple[float, ...]:
    """fx, fy, cx, cy [px] and what distortion follows."""
    if record.model in ONE_FOCAL_LENGTH:
        return record.parameters[:1] + record.parameters
    if record.model in TWO_FOCAL_LENGTHS:
        return record.parameters
    problem = f"the camera model {record.model} is not supported; undistort the images to PINHOLE first"
    raise record_error(path, record.where, problem)


def _camera_from_world(path: Path, image: ImageRecord) -> npt.NDArray[np.float64]:
    """(3, 4). Raises StippleError for a quaternion without a direction and for numbers that are not finite."""
    quaternion, translation = np.array(image.quaternion), np.array(image.translation)
    with np.errstate(over="ignore", invalid="ignore"):
        length = float(np.linalg.norm(quaternion))
    if not (np.isfinite(length) and np.isfinite(translation).all() and length > 0):
        problem = f"{image.name} has no valid pose; give a quaternion other than zero and finite numbers"
        raise record_error(path, image.where, problem)
    w, x, y, z = quaternion / length
    rotation = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )
    return np.hstack([rotation, translation[:, None]])
