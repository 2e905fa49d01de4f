# SPDX-License-Identifier: GPL-3.0-or-later
"""Photographs behind the picture of a Blender camera: one image, or a numbered sequence."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import bpy

from ..engine.camera import Camera

LAST_NUMBER = re.compile(r"(.*?)(\d+)(\D*)$")


def load_background(b_camera: Any, path: Path, camera: Camera, frame_shape: float) -> Any:
    """Shows the image behind the camera's picture and returns its background entry; None if it cannot be loaded.

    Pixels are read when they are first shown. The image fills the width of a frame of `frame_shape` (width / height
    as displayed), as the view does.
    """
    try:
        b_image = bpy.data.images.load(str(path), check_existing=True)
    except RuntimeError:
        return None
    b_background = b_camera.background_images.new()
    b_background.image = b_image
    view_shape = camera.width / camera.height * camera.fy / camera.fx
    b_background.frame_method = "CROP" if view_shape < frame_shape else "FIT"
    b_camera.show_background_images = True
    return b_background


def sequence_start(paths: Sequence[Path | None]) -> int | None:
    """The first image's number where the images are one sequence that Blender can play, else None.

    That is: all there, in one folder, with names that differ in their last number only, counting up by one.
    """
    numbers, frames = [], set()
    for path in paths:
        match = LAST_NUMBER.match(path.name) if path else None
        if path is None or match is None:
            return None
        numbers.append(int(match[2]))
        frames.add((path.parent, match[1], match[3]))
    consecutive = numbers == list(range(numbers[0], numbers[0] + len(numbers)))
    return numbers[0] if consecutive and len(frames) == 1 else None


def play_sequence(b_background: Any, first_number: int, frame_start: int, count: int) -> None:
    """Makes a background image the sequence it belongs to: image `first_number` at the scene's frame `frame_start`."""
    b_background.image.source = "SEQUENCE"
    b_user = b_background.image_user
    b_user.frame_start, b_user.frame_duration, b_user.frame_offset = frame_start, count, first_number - 1
    b_user.use_auto_refresh = True
