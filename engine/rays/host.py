# SPDX-License-Identifier: GPL-3.0-or-later
"""What *rays* asks of a graphics interface; `moderngl_device` answers outside Blender."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
import numpy.typing as npt

from .interface import Texture

FloatArray = npt.NDArray[np.float32]

# Corners of a triangle strip: the columns of the canonical quad O (RayGS, below Eq. 7), its last two exchanged.
STRIP = np.array([[-1, -1], [-1, 1], [1, -1], [1, 1]], np.float32)


@dataclass(frozen=True)
class Draw:
    """One draw of all splats of all instances into a cleared target.

    - `instance_count`: texels of `interface.ORDER` in use.
    - `constants`: a value for each of `interface.CONSTANTS`.
    - `stochastic`: depth test on, blending off, depth written by the shader; else premultiplied "over", no depth test.
    - `multisamples`: rays per pixel, averaged; 1 for the pixel's centre.
    """

    width: int
    height: int
    instance_count: int
    constants: dict[str, tuple[float, ...] | tuple[int, ...]]
    stochastic: bool = False
    multisamples: int = 1


class RasterHost(Protocol):
    """A graphics interface. Not for several threads: it belongs to the one that made it."""

    largest_texture: int

    def upload(self, texture: Texture, texels: FloatArray) -> None:
        """Replace a texture by (H, W, 4) float32 texels."""

    def release(self) -> None:
        """Give everything back; the host cannot be used again."""

    def draw(self, draw: Draw) -> tuple[FloatArray, FloatArray]:
        """(H, W, 4) premultiplied colour and (H, W) depth times coverage, rows from the picture's top."""
