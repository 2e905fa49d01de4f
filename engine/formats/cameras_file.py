# SPDX-License-Identifier: GPL-3.0-or-later
"""Camera files: which layout a JSON file has, and what the layouts share.

| layout                       | told by                     | read by              |
|------------------------------|-----------------------------|----------------------|
| INRIA `cameras.json`         | a list of objects           | `cameras_inria`      |
| nerfstudio `transforms.json` | an object with `frames`     | `cameras_nerfstudio` |
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

from ..camera import Camera
from ..errors import StippleError
from . import cameras_inria, cameras_nerfstudio
from .source_file import open_source


@dataclass(frozen=True)
class CameraFile:
    """What a camera file holds, in the file's order.

    - `names`: the image each camera belongs to, as the file gives it.
    - `warnings`: sentences about what the file asks for and Stipple leaves out, each once.
    """

    path: Path
    cameras: tuple[Camera, ...]
    names: tuple[str, ...]
    warnings: tuple[str, ...] = ()

    def camera(self, index: int) -> Camera:
        """The camera at `index`, from 0. Raises StippleError outside the file."""
        if not 0 <= index < len(self.cameras):
            raise StippleError(f"{self.path}: there is no camera {index}; choose 0 to {len(self.cameras) - 1}.")
        return self.cameras[index]


def read_camera_file(path: str | Path) -> CameraFile:
    """Reads every camera of an INRIA `cameras.json` or a nerfstudio `transforms.json`.

    The layout is told by the content, not by the name. Raises StippleError, with the file and the property, for a
    file that cannot be opened, is not JSON, has another layout, lacks a key or holds a value no camera can have.
    """
    path = Path(path)
    document = _load_json(path)
    if isinstance(document, list):
        found = cameras_inria.parse(document, path)
    elif isinstance(document, dict) and isinstance(document.get("frames"), list):
        found = cameras_nerfstudio.parse(document, path)
    else:
        raise StippleError(
            f"{path}: this is not a camera file; give an INRIA cameras.json (a list of cameras) "
            f'or a nerfstudio transforms.json (an object with "frames").'
        )
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


def _load_json(path: Path) -> object:
    with open_source(path) as file:
        content = file.read()
    try:
        return json.loads(content.decode("utf-8-sig"))
    except (ValueError, RecursionError) as error:  # bad UTF-8, bad JSON, a number of thousands of digits
        where = f" at line {error.lineno}" if isinstance(error, json.JSONDecodeError) else ""
        raise StippleError(f"{path}: not valid JSON{where}; give a cameras.json or transforms.json.") from error
