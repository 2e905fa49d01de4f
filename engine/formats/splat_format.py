# SPDX-License-Identifier: GPL-3.0-or-later
"""What a format of splat files is, and what reading one gives."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from ..splats import SplatChunk, SplatCloud
from .atomic_file import Place

if TYPE_CHECKING:
    from .splat_source import SplatSource

AnyPath = str | os.PathLike[str]


@dataclass(frozen=True)
class LoadedSplats:
    """A capture read from a file.

    - `cloud`: its renderable splats, named after the file's stem.
    - `dropped`: how many splats of the file were left out because they cannot be rendered.
    - `warnings`: sentences for the user, each with the file's path; one of them where `dropped` is not zero.
    """

    cloud: SplatCloud
    dropped: int
    warnings: tuple[str, ...]


@dataclass(frozen=True)
class SplatFormat:
    """One file format of the registry.

    - `name`: as the user knows it; `suffixes`: lower case, with the dot.
    - `recognises`: whether a file that begins with these bytes is of this format.
    - `open`, `write`: raise StippleError; `open` reads the header, `write` replaces the file, by `replacing` or what
      stands in for it, with chunks of so many splats of an SH degree in all.
    """

    name: str
    suffixes: tuple[str, ...]
    recognises: Callable[[bytes], bool]
    open: Callable[[Path], SplatSource]
    write: Callable[[Path, Iterable[SplatCloud | SplatChunk], int, int, Place], None]
