# SPDX-License-Identifier: GPL-3.0-or-later
"""What *rays* asks of a graphics interface; `moderngl_device` answers outside Blender."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
import numpy.typing as npt

from .interface import QUADS_PER_BATCH, Texture, Variant

FloatArray = npt.NDArray[np.float32]


def batch_corners() -> FloatArray:
    """(4 Q, 3): the columns of the canonical quad O (RayGS, below Eq. 7), and the quad's number in the batch."""
    quad = np.array([[-1, -1], [-1, 1], [1, 1], [1, -1]], np.float32)
    number = np.repeat(np.arange(QUADS_PER_BATCH, dtype=np.float32), 4)
    return np.column_stack([np.tile(quad, (QUADS_PER_BATCH, 1)), number])


def batch_triangles() -> npt.NDArray[np.int32]:
    """(2 Q, 3): vertices of the triangles of `batch_corners`."""
    first = 4 * np.arange(QUADS_PER_BATCH, dtype=np.int32)[:, None, None]
    return (first + np.array([[0, 1, 2], [0, 2, 3]], np.int32)).reshape(-1, 3)


@dataclass(frozen=True)
class Draw:
    """One draw of all splats of all instances into a cleared target.

    - `splat_count`: texels of `interface.ORDER` in use; also the last of the constant `modes`.
    - `constants`: a value for each of `interface.CONSTANTS`.
    - `variant`: of the shaders. Stochastic: depth test on, blending off, depth written by the shader; else
      premultiplied "over", no depth test.
    - `multisamples`: rays per pixel, averaged; 1 for the pixel's centre.
    """

    width: int
    height: int
    splat_count: int
    constants: dict[str, tuple[float, ...] | tuple[int, ...]]
    variant: Variant
    multisamples: int = 1

    @property
    def batch_count(self) -> int:
        """Instances of the batch to draw."""
        return -(-self.splat_count // QUADS_PER_BATCH)


class RasterHost(Protocol):
    """A graphics interface. Not for several threads: it belongs to the one that made it."""

    largest_texture: int

    def upload(self, texture: Texture, texels: FloatArray) -> None:
        """Replace a texture by (H, W, 4) float32 texels."""

    def release(self) -> None:
        """Give everything back; the host cannot be used again."""

    def draw(self, draw: Draw) -> tuple[FloatArray, FloatArray]:
        """(H, W, 4) premultiplied colour and (H, W) depth times coverage, rows from the picture's top."""
