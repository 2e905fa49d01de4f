# SPDX-License-Identifier: GPL-3.0-or-later
"""Which pictures `stipple render` makes: one camera and one file name each."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import click

from .camera import Camera
from .cli_types import CameraChoice
from .formats.cameras_file import CameraFile
from .orbit import frame_clouds, orbit
from .splats import SplatCloud

NUMBER_PATTERN = re.compile(r"#+|%0?\d*d")
DEFAULT_SIZE = (1280, 720)


@dataclass(frozen=True)
class View:
    """A camera and the number of its picture."""

    camera: Camera
    number: int


@dataclass(frozen=True)
class OrbitOptions:
    """`count` is None where no orbit was asked for; the angles are in degrees, as typed."""

    count: int | None
    up: str
    elevation_deg: float
    fov_deg: float


def has_number(path: Path) -> bool:
    """Whether the file name has a place for a number: #### as in Blender, or %04d as in printf."""
    return NUMBER_PATTERN.search(path.name) is not None


def numbered(path: Path, number: int) -> Path:
    """`path` with `number` in the last such place of its name, at least as wide as the place; else unchanged."""
    places = list(NUMBER_PATTERN.finditer(path.name))
    if not places:
        return path
    place = places[-1]
    width = len(place[0]) if place[0].startswith("#") else int(place[0][1:-1] or 0)
    return path.with_name(f"{path.name[: place.start()]}{number:0{width}d}{path.name[place.end() :]}")


def check_choice(out: Path, camera: CameraChoice | None, orbit_count: int | None) -> None:
    """Raises click.UsageError for options that contradict each other."""
    if camera is not None and orbit_count is not None:
        raise click.UsageError("--camera and --orbit both place the camera; give one of them.")
    if orbit_count is not None and orbit_count > 1 and not has_number(out):
        raise click.UsageError(f"--orbit {orbit_count} makes that many pictures; put #### into --out to number them.")


def views_of_file(
    camera_file: CameraFile, index: int | None, every: bool, size: tuple[int, int] | None
) -> tuple[View, ...]:
    """Camera `index` of a file; without one all of them, or the first. Numbers are the file's indices, from 0."""
    if index is not None:
        chosen = [View(camera_file.camera(index), index)]
    elif every:
        chosen = [View(camera, number) for number, camera in enumerate(camera_file.cameras)]
    else:
        chosen = [View(camera_file.camera(0), 0)]
    if size is None:
        return tuple(chosen)
    return tuple(View(view.camera.resized(*size), view.number) for view in chosen)


def views_around(clouds: Sequence[SplatCloud], options: OrbitOptions, size: tuple[int, int] | None) -> tuple[View, ...]:
    """The orbit asked for, or its first view alone; numbered from 0."""
    width, height = size or DEFAULT_SIZE
    cameras = orbit(
        frame_clouds(clouds),
        options.count or 1,
        width=width,
        height=height,
        fov_y=math.radians(options.fov_deg),
        elevation=math.radians(options.elevation_deg),
        up=options.up,
    )
    return tuple(View(camera, number) for number, camera in enumerate(cameras))
