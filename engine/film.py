# SPDX-License-Identifier: GPL-3.0-or-later
"""The film: sums over samples, and the picture they make.

Sums are taken in the space the capture was trained in (sRGB-encoded), premultiplied with coverage, in float64, so that
the millionth sample counts as much as the first.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt
import warp as wp

from .buffers import Buffers
from .device import launch
from .light import PIXELS, ToLight, end_of_block, launch_blocks, light_from_display, linearise, to_light_of

wp.set_module_options({"enable_backward": False})

NOTHING = wp.vec4(0.0, 0.0, 0.0, 0.0)

Ground = tuple[float, float, float] | wp.array | None
"""What is behind the splats: a colour or an array of (r, g, b, 1) per pixel, sRGB-encoded; None is transparent."""
Finish = Callable[[wp.array, wp.array], None]

# What a pixel takes [bytes]: sums, their mean, and the host's copy of that.
BYTES_PER_PIXEL = {"film_colour": 32, "film_depth": 8, "film_rgba": 16, "film_mean_depth": 4, "host copy": 20}


@dataclass
class RenderStats:
    """What a render did. `points` and `blends` count over all samples; a method leaves the other's at 0.

    Stage times are wall seconds, and core seconds of the whole process (meaningless on CUDA); see `timing`.
    """

    seconds: float = 0.0
    peak_bytes: int = 0
    splats_visible: int = 0
    points: int = 0
    blends: int = 0
    warnings: tuple[str, ...] = ()
    stage_seconds: dict[str, float] = field(default_factory=dict)
    stage_core_seconds: dict[str, float] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class Picture:
    """A resolved film in host memory.

    - `rgba` (H, W, 4) float32: rows from the top, sRGB-encoded, premultiplied (the blend space); may exceed 1.
    - `depth` (H, W) float32: mean depth along z of what is seen [world units], +inf where nothing is.
    - `samples`: samples in the mean.
    """

    rgba: npt.NDArray[np.float32]
    depth: npt.NDArray[np.float32]
    samples: int
    stats: RenderStats = field(default_factory=RenderStats)


@dataclass(frozen=True, eq=False)
class Light:
    """A resolved film as hosts show it. On a CPU `rgba` is the film's own memory: it stands until the next picture.

    - `rgba` (H, W, 4) float32: rows from the bottom, premultiplied scene-linear light in the host's working space.
    - `depth` (H, W) float32: as Picture's, but rows from the bottom.
    - `samples`: samples in the mean.
    """

    rgba: npt.NDArray[np.float32]
    depth: npt.NDArray[np.float32]
    samples: int
    stats: RenderStats = field(default_factory=RenderStats)


@wp.struct
class FilmSums:
    """Per pixel of the window, rows from the top."""

    colour: wp.array(dtype=wp.vec4d)  # premultiplied colour and coverage
    depth: wp.array(dtype=wp.float64)  # depth times coverage


@wp.func
def over(front: wp.vec4, background: wp.vec4) -> wp.vec4:
    """Both premultiplied."""
    return front + (1.0 - front[3]) * background


@wp.func
def resolve_pixel(
    pixel: wp.int32,
    sums: FilmSums,
    samples: wp.float64,
    background: wp.vec4,
    behind: wp.array(dtype=wp.vec4),
    rgba: wp.array(dtype=wp.vec4),
    depth: wp.array(dtype=wp.float32),
) -> None:
    colour = sums.colour[pixel] / samples
    depth[pixel] = wp.where(colour[3] > wp.float64(0.0), wp.float32(sums.depth[pixel] / samples / colour[3]), wp.inf)
    if behind.shape[0] > 0:
        background = behind[pixel]
    rgba[pixel] = over(wp.vec4(colour), background)


@wp.kernel
def resolve_film_kernel(
    first: wp.int32,
    sums: FilmSums,
    samples: wp.float64,
    background: wp.vec4,
    behind: wp.array(dtype=wp.vec4),  # of every pixel, or empty where `background` is behind them all
    rgba: wp.array(dtype=wp.vec4),
    depth: wp.array(dtype=wp.float32),
) -> None:
    resolve_pixel(first + wp.tid(), sums, samples, background, behind, rgba, depth)


@wp.kernel
def resolve_light_kernel(
    first: wp.int32,
    sums: FilmSums,
    samples: wp.float64,
    background: wp.vec4,
    behind: wp.array(dtype=wp.vec4),
    rgba: wp.array(dtype=wp.vec4),
    depth: wp.array(dtype=wp.float32),
    to_light: ToLight,
) -> None:
    begin = (first + wp.tid()) * PIXELS
    end = end_of_block(begin, to_light)
    for pixel in range(begin, end):
        row = pixel / to_light.columns
        resolve_pixel(pixel, sums, samples, background, behind, rgba, depth)
        partner = pixel + (to_light.rows - 1 - 2 * row) * to_light.columns
        resolve_pixel(partner, sums, samples, background, behind, rgba, depth)
    linearise(rgba, begin, end, to_light.columns, to_light.rows, to_light.mixed, to_light.matrix)


@wp.kernel
def put_over_kernel(
    first: wp.int32, background: wp.vec4, behind: wp.array(dtype=wp.vec4), rgba: wp.array(dtype=wp.vec4)
) -> None:
    pixel = first + wp.tid()
    if behind.shape[0] > 0:
        background = behind[pixel]
    rgba[pixel] = over(rgba[pixel], background)


class Film:
    """Accumulates samples of one window."""

    def __init__(self, width: int, height: int, buffers: Buffers) -> None:
        self.width, self.height, self.device = width, height, buffers.device
        self.samples = 0
        count = width * height
        self.sums = FilmSums()
        self.sums.colour = buffers.array("film_colour", wp.vec4d, count)
        self.sums.depth = buffers.array("film_depth", wp.float64, count)
        # Now, so that no finished render lacks the memory to be looked at.
        self._rgba = buffers.array("film_rgba", wp.vec4, count).reshape((height, width))
        self._mean_depth = buffers.array("film_mean_depth", wp.float32, count).reshape((height, width))
        self.sums.colour.zero_()
        self.sums.depth.zero_()

    def resolve(self, ground: Ground, stats: RenderStats, finish: Finish | None = None) -> Picture:
        """The mean so far over `ground`. May be called at any time.

        `finish` may change what the splats are, rgba without the background and depth, on the device.
        """
        if finish is None:
            launch(resolve_film_kernel, self._rgba.size, self._inputs(ground), self.device)
        else:
            self._finished(ground, finish)
        return Picture(
            # Copies: the buffers are written again by the next frame.
            rgba=np.array(self._rgba.numpy()),
            depth=np.array(self._mean_depth.numpy()),
            samples=self.samples,
            stats=stats,
        )

    def resolve_light(
        self, ground: Ground, stats: RenderStats, working_space: str, finish: Finish | None = None
    ) -> Light:
        """As `resolve`, turned into light on the device and not copied: what hosts take that show every frame.

        Block by block while it is in the cache: 10 ms at 1080p, 15 for one after the other (two cores of an EPYC).
        Raises StippleError for an unknown working space.
        """
        if finish is None:
            to_light = to_light_of(self.height, self.width, working_space)
            launch_blocks(resolve_light_kernel, self._inputs(ground), to_light, self.device)
        else:
            self._finished(ground, finish)
            light_from_display(self._rgba, working_space)
        return Light(self._rgba.numpy(), self._mean_depth.numpy()[::-1], self.samples, stats)

    def _inputs(self, ground: Ground) -> list[Any]:
        """What the kernels that resolve take: the sums, their number, what is behind them, and the mean's buffers."""
        mean = [self._rgba.flatten(), self._mean_depth.flatten()]
        return [self.sums, float(max(self.samples, 1)), *_behind(ground), *mean]

    def _finished(self, ground: Ground, finish: Finish) -> None:
        """The mean into the buffers, `finish` of it, and that over `ground`."""
        rgba, depth = self._rgba.flatten(), self._mean_depth.flatten()
        launch(resolve_film_kernel, rgba.size, self._inputs(None), self.device)
        finish(rgba, depth)
        launch(put_over_kernel, rgba.size, [*_behind(ground), rgba], self.device)


def _behind(ground: Ground) -> tuple[wp.vec4, wp.array | None]:
    """One colour that is behind all pixels, and the array of those that are not one."""
    colour = wp.vec4(*ground, 1.0) if isinstance(ground, tuple) else NOTHING
    return colour, ground if isinstance(ground, wp.array) else None
