# SPDX-License-Identifier: GPL-3.0-or-later
"""How the `stipple` command spells sizes, colours and cameras: click callbacks from text to values.

Each raises click.BadParameter (exit status 2) with an example of the right spelling.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import click


@dataclass(frozen=True)
class CameraChoice:
    """A camera file, and which of its cameras; None for the first or all of them."""

    path: Path
    index: int | None


def size_of(context: click.Context, parameter: click.Parameter, text: str | None) -> tuple[int, int] | None:
    """WIDTHxHEIGHT [px], to (width, height)."""
    if text is None:
        return None
    match = re.fullmatch(r"(\d{1,6})[xX×](\d{1,6})", text.strip())
    width, height = (int(match[1]), int(match[2])) if match else (0, 0)
    if width < 1 or height < 1:
        raise click.BadParameter(f"{text!r} is not a size; write it as 1280x720.")
    return width, height


def background_of(context: click.Context, parameter: click.Parameter, text: str) -> tuple[float, float, float] | None:
    """R,G,B from 0 to 1, sRGB-encoded; `transparent` is None."""
    if text.strip() == "transparent":
        return None
    try:
        red, green, blue = (float(part) for part in text.split(","))
    except ValueError:
        raise click.BadParameter(f"{text!r} is not a colour; write transparent, or R,G,B such as 1,1,1.") from None
    if not all(0.0 <= channel <= 1.0 for channel in (red, green, blue)):
        raise click.BadParameter(f"{text!r} leaves the range; give each of R,G,B from 0 to 1.")
    return red, green, blue


def camera_of(context: click.Context, parameter: click.Parameter, text: str | None) -> CameraChoice | None:
    """FILE or FILE:INDEX. A file whose own name ends in :digits wins over the index."""
    if text is None:
        return None
    file, colon, index = text.rpartition(":")
    if colon and file and index.isascii() and index.isdigit() and not Path(text).exists():
        return CameraChoice(Path(file), int(index))
    return CameraChoice(Path(text), None)
