# SPDX-License-Identifier: GPL-3.0-or-later
"""Camera files: which layout a path has, and what the layouts share.

| layout                       | told by                                       | read by              |
|------------------------------|-----------------------------------------------|----------------------|
| COLMAP sparse model          | a folder, or `cameras`/`images` `.bin`/`.txt` | `cameras_colmap`     |
| INRIA `cameras.json`         | JSON: a list of objects                       | `cameras_inria`      |
| nerfstudio `transforms.json` | JSON: an object with `frames`                 | `cameras_nerfstudio` |
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

from ..camera import Camera
from ..errors import StippleError
from . import cameras_colmap, cameras_inria, cameras_nerfstudio
from .cameras_entry import Entry
from .source_file import open_source


@dataclass(frozen=True)
class CameraFile:
    """What a camera file holds, in the file's order; a COLMAP model's views are sorted by name.

    - `path`: the file, or the folder in which a COLMAP model lies.
    - `names`: the image each camera belongs to, as the file gives it.
    - `warnings`: sentences about what the file asks for and Stipple leaves out, each once.
    """

    path: Path
    cameras: tuple[Camera, ...]
    names: tuple[str, ...]
    warnings: tuple[str, ...] = ()

    @property
    def folder(self) -> Path:
        """Where the file lies; what it says about other files is relative to this."""
        return self.path if self.path.is_dir() else self.path.parent

    def camera(self, index: int) -> Camera:
        """The camera at `index`, from 0. Raises StippleError outside the file."""
        if not 0 <= index < len(self.cameras):
            raise StippleError(f"{self.path}: there is no camera {index}; choose 0 to {len(self.cameras) - 1}.")
        return self.cameras[index]


def read_camera_file(path: str | Path) -> CameraFile:
    """Reads every camera of a COLMAP model, an INRIA `cameras.json` or a nerfstudio `transforms.json`.

    `path` is a JSON file, whose layout is told by its content and not by its name, or a COLMAP model (see
    `cameras_colmap.parse`). Raises StippleError, with the file and the property, for a file that cannot be opened, is
    damaged, has another layout, lacks a key or holds a value no camera can have.
    """
    path = Path(path)
    if cameras_colmap.is_model(path):
        path, found = cameras_colmap.parse(path)
    else:
        found = _parse_json(path)
    if not found:
        raise StippleError(f"{path}: there are no cameras in it; choose a file with at least one.")
    return CameraFile(
        path=path,
        cameras=tuple(entry.camera for entry in found),
        names=tuple(entry.name for entry in found),
        warnings=tuple(dict.fromkeys(warning for entry in found for warning in entry.warnings)),
    )


def read_cameras(path: str | Path) -> tuple[Camera, ...]:
    """The cameras of `read_camera_file`, for callers that show no warnings."""
    return read_camera_file(path).cameras


def _parse_json(path: Path) -> list[Entry]:
    document = _load_json(path)
    if isinstance(document, list):
        return cameras_inria.parse(document, path)
    if isinstance(document, dict) and isinstance(document.get("frames"), list):
        return cameras_nerfstudio.parse(document, path)
    raise StippleError(
        f"{path}: this is not a camera file; give an INRIA cameras.json (a list of cameras), "
        f'a nerfstudio transforms.json (an object with "frames") or the folder of a COLMAP model.'
    )


def _load_json(path: Path) -> object:
    with open_source(path) as file:
        content = file.read()
    try:
        return json.loads(content.decode("utf-8-sig"))
    except (ValueError, RecursionError) as error:  # bad UTF-8, bad JSON, a number of thousands of digits
        where = f" at line {error.lineno}" if isinstance(error, json.JSONDecodeError) else ""
        raise StippleError(f"{path}: not valid JSON{where}; give a cameras.json or transforms.json.") from error
