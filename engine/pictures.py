# SPDX-License-Identifier: GPL-3.0-or-later
"""Pictures as files: PNG, OpenEXR and NumPy, chosen by suffix. A file is there whole or not at all."""

from __future__ import annotations

import importlib
import os
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, BinaryIO

import numpy as np
import numpy.typing as npt

from .colour import WORKING_SPACES, bytes_from_display, scene_linear_from_display
from .errors import StippleError
from .formats.atomic_file import replacing

if TYPE_CHECKING:
    from .film import Picture

DEPTH_EMPTY = 1e10  # depth where nothing is seen, in files: what Blender's own renderers write
DEPTH_CHANNEL = "Depth.Z"


def write_picture(path: str | Path, picture: Picture, *, opaque: bool | None = None) -> None:
    """Writes `picture` in the format of the suffix of `path`, replacing what is there.

    - `.png`: 8-bit sRGB. RGBA with straight alpha, or RGB where the picture is opaque.
    - `.exr`: float32, scene-linear Rec.709 (named by the chromaticities attribute), premultiplied: R, G, B, A, and
      `Depth.Z` [world units along the view axis], 1e10 where nothing is seen. The channels without a layer name are
      what every viewer shows; Blender's compositor reads the file as Combined and Depth. (`ViewLayer.Depth.Z`
      beside plain RGBA loses the depth there, and plain `Z` as well.) ZIP-compressed, lossless.
    - `.npy`: float32 (H, W, 4), rows from the top, sRGB-encoded premultiplied: the blend space, unchanged.

    `opaque` says whether a PNG has no alpha channel; None decides by the picture. Say it for the frames of an
    animation, which should all have the same channels.

    Folders are created as needed. The file is written under another name in its own folder and then renamed, so an
    interrupted run leaves nothing half-written. Raises StippleError for an unknown suffix, a missing optional
    library, or a place that cannot be written.
    """
    path = Path(path)
    check_writable(path)
    if opaque is None:
        opaque = bool((picture.rgba[..., 3] >= 1 - 0.5 / 255).all())
    write = WRITERS[path.suffix.lower()]
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with replacing(path) as file:
            write(file, picture, opaque)
    except (OSError, RuntimeError) as error:  # OpenEXR raises RuntimeError
        raise StippleError(f"{path}: it cannot be written ({error}); choose another folder or make room.") from error


def check_writable(path: str | Path) -> None:
    """Finds out before a long render whether `write_picture(path, …)` can work: suffix, library and folder.

    Writes nothing. Raises StippleError with what is wrong.
    """
    path = Path(path)
    suffix = path.suffix.lower()
    if suffix not in WRITERS:
        raise StippleError(f"{path}: {suffix or 'no suffix'} is not a picture format; choose {', '.join(WRITERS)}.")
    if suffix == ".png":
        _pillow_image()
    elif suffix == ".exr":
        _openexr()
    if path.is_dir():
        raise StippleError(f"{path}: this is a folder; give the name of a file.")
    folder = next((parent for parent in path.absolute().parents if parent.exists()), None)
    if folder is None or not folder.is_dir() or not os.access(folder, os.W_OK | os.X_OK):
        raise StippleError(f"{path}: {folder or path.anchor} is not a folder that can be written; choose another.")


def _write_png(file: BinaryIO, picture: Picture, opaque: bool) -> None:
    pixels = bytes_from_display(picture.rgba)
    image = _pillow_image().fromarray(np.ascontiguousarray(pixels[..., :3]) if opaque else pixels)
    image.save(file, format="PNG", compress_level=4)


def _write_exr(file: BinaryIO, picture: Picture, opaque: bool) -> None:
    openexr = _openexr()
    primaries = WORKING_SPACES["Rec.709"]
    header = {
        "type": openexr.scanlineimage,
        "compression": openexr.ZIP_COMPRESSION,
        "chromaticities": primaries.red + primaries.green + primaries.blue + primaries.white,
    }
    rgba = scene_linear_from_display(picture.rgba.astype(np.float32, copy=False))
    depth = np.where(np.isfinite(picture.depth), picture.depth, DEPTH_EMPTY).astype(np.float32)
    channels = {"RGBA": np.ascontiguousarray(rgba), DEPTH_CHANNEL: depth}
    openexr.File(header, channels).write(file.name)  # by name: OpenEXR 3.3 knows no streams


def _write_npy(file: BinaryIO, picture: Picture, opaque: bool) -> None:
    rgba: npt.NDArray[np.float32] = np.ascontiguousarray(picture.rgba, dtype=np.float32)
    np.save(file, rgba, allow_pickle=False)


WRITERS: dict[str, Callable[[BinaryIO, Picture, bool], None]] = {
    ".png": _write_png,
    ".exr": _write_exr,
    ".npy": _write_npy,
}


def _pillow_image() -> ModuleType:
    return _optional("PIL.Image", "pillow", "PNG")


def _openexr() -> ModuleType:
    return _optional("OpenEXR", "OpenEXR", "OpenEXR")


def _optional(module: str, package: str, file_format: str) -> ModuleType:
    try:
        return importlib.import_module(module)
    except ImportError as error:
        raise StippleError(f"writing {file_format} needs the Python package {package}; install it with pip.") from error
