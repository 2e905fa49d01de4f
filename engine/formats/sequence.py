# SPDX-License-Identifier: GPL-3.0-or-later
"""Numbered files (`walk.0001.ply`, `walk.0002.ply`, …) as one moving capture: which file a moment shows.

The number is the last run of digits of the name before its suffix. Numbers may be missing. Nothing is read here.
"""

from __future__ import annotations

import math
import os
import re
from bisect import bisect_right
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from ..errors import StippleError
from .splat_format import AnyPath

NUMBER = re.compile(r"(?P<before>.*?)(?P<digits>\d+)(?P<after>\D*)", re.DOTALL)
SEPARATORS = "._- "
ROUNDING = 1e-6  # [files] by which a product of frames and speed may fall short of a whole number


@dataclass(frozen=True)
class NumberedFiles:
    """The files of a folder whose names differ by a number only.

    `paths` by number; there is at least one.
    """

    paths: dict[int, Path]

    @cached_property
    def numbers(self) -> tuple[int, ...]:
        """Ascending."""
        return tuple(sorted(self.paths))

    @property
    def length(self) -> int:
        """Places from the first number to the last, missing ones included."""
        return self.numbers[-1] - self.numbers[0] + 1

    @property
    def missing(self) -> int:
        """Places without a file."""
        return self.length - len(self.numbers)

    def at(self, place: int) -> tuple[int, Path]:
        """The number and the file at a place from 0 to `length` - 1: where it is missing, the nearest earlier one's."""
        index = bisect_right(self.numbers, self.numbers[0] + place) - 1
        number = self.numbers[max(index, 0)]
        return number, self.paths[number]


def find_numbered(path: AnyPath) -> NumberedFiles:
    """All files beside `path`, which need not exist itself, that have its name but for the number.

    Numbers may be padded to any width (`2`, `02`, `0002` are one number; then the name first in order counts). Raises
    StippleError where the name has no number, or the folder cannot be read or has no such file.
    """
    path = Path(path)
    match = NUMBER.fullmatch(path.stem)
    if match is None:
        raise StippleError(
            f"{path}: the name has no number; a sequence has names such as {path.stem}.0001{path.suffix}."
        )
    same = re.compile(re.escape(match["before"]) + r"(\d+)" + re.escape(match["after"] + path.suffix))
    try:
        with os.scandir(path.parent) as entries:
            names = sorted(entry.name for entry in entries)
    except OSError as error:
        reason = error.strerror or str(error)
        raise StippleError(f"{path}: the folder of the sequence cannot be read ({reason}); choose it again.") from error
    paths: dict[int, Path] = {}
    for name in names:
        found = same.fullmatch(name)
        if found and found[1].isascii():
            paths.setdefault(int(found[1]), path.parent / name)
    if not paths:
        raise StippleError(f"{path}: no file of the sequence is there; choose one of its files again.")
    return NumberedFiles(paths)


def name_of_sequence(path: AnyPath) -> str:
    """The name of a file without its number and what separates it: `walk` for `walk.0001.ply`."""
    match = NUMBER.fullmatch(Path(path).stem)
    name = f"{match['before'].rstrip(SEPARATORS)}{match['after']}" if match else ""
    return name.strip(SEPARATORS) or Path(path).stem


def is_numbered(path: AnyPath) -> bool:
    """Whether a sequence could be made of this file's name."""
    return NUMBER.fullmatch(Path(path).stem) is not None


@dataclass(frozen=True)
class Playback:
    """How frames of the host become places in a sequence.

    - `start`: the frame that shows the first place; with a negative speed, the last.
    - `speed`: places per frame. Below 1 a file stays for several frames, above 1 some are left out, 0 stands still;
      negative plays backwards.
    - `offset`: added to the place, before looping; animate it with speed 0 to say which file is shown when.
    - `loop`: one of `LOOPS`.
    """

    start: float = 1.0
    speed: float = 1.0
    offset: int = 0
    loop: str = "extend"

    def place(self, frame: float, length: int) -> int | None:
        """The place 0 … length - 1 shown at a frame, which may be fractional; None where nothing is."""
        travelled = math.floor((frame - self.start) * abs(self.speed) + ROUNDING)
        first = length - 1 if self.speed < 0 else 0
        return LOOPS[self.loop](first + (-travelled if self.speed < 0 else travelled) + self.offset, length)


def _clip(place: int, length: int) -> int | None:
    return place if 0 <= place < length else None


def _extend(place: int, length: int) -> int | None:
    return min(max(place, 0), length - 1)


def _repeat(place: int, length: int) -> int | None:
    return place % length


def _ping_pong(place: int, length: int) -> int | None:
    """Back and forth; the ends are not shown twice in a row."""
    period = max(1, 2 * (length - 1))
    place %= period
    return min(place, period - place)


LOOPS: dict[str, Callable[[int, int], int | None]] = {
    "clip": _clip,
    "extend": _extend,
    "repeat": _repeat,
    "ping_pong": _ping_pong,
}
"""What is shown before the first and after the last place: nothing, that place, or the sequence again."""
