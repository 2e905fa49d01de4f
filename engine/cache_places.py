# SPDX-License-Identifier: GPL-3.0-or-later
"""Where the cache file of a capture is: beside it, or in the user's cache folder."""

from __future__ import annotations

import hashlib
import os
import sys
import tempfile
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

SUFFIX = ".stipple-cache"
VARIABLE = "STIPPLE_CACHE"  # "beside" (the default), "off", or a folder


@dataclass(frozen=True)
class CachePlaces:
    """Which places are looked at and written to.

    - `beside`: the capture's own folder, where it can be written to.
    - `folder`: for captures whose folder cannot be, and for all where `beside` is off; None for nowhere.
    - `smallest_bytes`: files below it are not worth a cache, for reading them takes no time.
    """

    beside: bool = True
    folder: Path | None = None
    smallest_bytes: int = 1 << 26

    def of(self, capture: Path) -> tuple[Path, ...]:
        """Where a capture's cache may be, the first choice first."""
        places = [capture.with_name(capture.name + SUFFIX)] if self.beside else []
        if self.folder is not None:
            # Folders have captures of one name: point_cloud.ply, mostly.
            key = hashlib.blake2b(os.fsencode(capture), digest_size=8).hexdigest()
            places.append(self.folder / f"{capture.stem[:80]}-{key}{SUFFIX}")
        return tuple(places)

    def to_write(self, capture: Path) -> Path | None:
        """The first place that can be written to, its folder made; None where there is none."""
        for place in self.of(capture):
            with suppress(OSError):
                if place.parent == self.folder:
                    place.parent.mkdir(parents=True, exist_ok=True)
                with tempfile.TemporaryFile(dir=place.parent):  # what os.access says differs from system to system
                    return place
        return None


def places_from_environment() -> CachePlaces:
    """What STIPPLE_CACHE says."""
    choice = os.environ.get(VARIABLE, "") or "beside"
    if choice == "off":
        return CachePlaces(beside=False)
    if choice == "beside":
        return CachePlaces(folder=user_cache_folder())
    return CachePlaces(beside=False, folder=Path(choice).expanduser())


def user_cache_folder() -> Path:
    """The folder for this user's caches, as each system has it; not made yet."""
    if sys.platform == "win32":
        return Path(os.environ.get("LOCALAPPDATA") or Path.home() / "AppData" / "Local") / "stipple" / "cache"
    if sys.platform == "darwin":
        return Path.home() / "Library" / "Caches" / "stipple"
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "stipple"
