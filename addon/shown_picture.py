# SPDX-License-Identifier: GPL-3.0-or-later
"""What a viewport's thread hands to its window: a picture and where it goes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from .view_camera import Rect, ViewportView


@dataclass(frozen=True, eq=False)
class ShownPicture:
    """What the viewport draws: (H, W, 4) float32, rows from the bottom, premultiplied scene-linear light.

    `place` is the part of the region that it covers [fractions from the bottom left].
    """

    rgba: npt.NDArray[np.float32]
    place: Rect
    divider: int
    samples: int
    sample_limit: int
    splats_visible: int
    seconds: float  # that the last sample took


def place_of(view: ViewportView, divider: int) -> Rect:
    """The rendered window as fractions of the region from the bottom left."""
    camera = view.camera(divider)
    x, y, width, height = camera.rendered_window
    return (
        x / camera.width,
        1 - (y + height) / camera.height,
        (x + width) / camera.width,
        1 - y / camera.height,
    )
