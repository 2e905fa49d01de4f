# SPDX-License-Identifier: GPL-3.0-or-later
"""The photographs that belong to the views of a camera file, found on the disk."""

from __future__ import annotations

from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from .cameras_file import CameraFile

IMAGE_SUFFIXES = (".jpg", ".jpeg", ".png", ".webp", ".tif", ".tiff", ".bmp", ".exr")  # in order of preference
IMAGE_FOLDERS = (".", "images", "../images", "../../images")  # the last: images beside COLMAP's sparse/0

Listings = dict[Path, dict[str, Path]]


def name_without_suffix(name: str) -> str:
    """The last part of an image's name, without the suffix where that is an image's; a trainer may leave it out."""
    last = PurePosixPath(name.replace("\\", "/")).name
    suffix = PurePosixPath(last).suffix
    return last[: -len(suffix)] if suffix.lower() in IMAGE_SUFFIXES else last


def find_images(file: CameraFile) -> tuple[Path | None, ...]:
    """For every view the image that its name means, or None where there is none; only names are looked at.

    A name is looked for as the path it is (absolute, or from the folder of the camera file), then in `images` there
    and in the two folders above, then by its last part alone in the same places. A name without an image's suffix
    takes a file that has one. Letters in another case count where nothing else is found. Raises nothing: a folder
    that cannot be read has no images.
    """
    folders: Listings = {}
    return tuple(find_image(file.folder, name, folders) for name in file.names)


def find_image(base: Path, name: str, folders: Listings) -> Path | None:
    """As `find_images` for one name in a camera file that lies in `base`; `folders` keeps what was listed."""
    given = Path(name.replace("\\", "/"))
    if not given.name:
        return None
    for parent in dict.fromkeys((given.parent, Path())):
        for place in IMAGE_FOLDERS:
            folder = base / place / parent
            if folder not in folders:  # listed once: views are many and the folder may be far away
                folders[folder] = _listing(folder)
            found = folders[folder].get(given.name) or folders[folder].get(given.name.lower())
            if found is not None:
                return found
    return None


def _listing(folder: Path) -> dict[str, Path]:
    """The images of a folder by every name that may mean them; names as they are win over shortened ones."""
    try:
        images = sorted(path for path in folder.iterdir() if path.suffix.lower() in IMAGE_SUFFIXES)
    except (OSError, ValueError):
        return {}
    images.sort(key=lambda path: IMAGE_SUFFIXES.index(path.suffix.lower()))
    listing: dict[str, Path] = {}
    for path in images:
        listing[path.name] = path
    for path in images:
        listing.setdefault(path.name.lower(), path)
    for path in images:
        listing.setdefault(path.stem, path)
    for path in images:
        listing.setdefault(path.stem.lower(), path)
    return listing
