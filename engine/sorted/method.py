# SPDX-License-Identifier: GPL-3.0-or-later
"""A frame of *sorted*, stage by stage."""

from __future__ import annotations

from collections.abc import Callable

import warp as wp

from ..film import Film
from ..shot import Shot
from .blend import blend_counter_count, blend_tiles
from .order import sort_by_depth
from .sampling import Sampling
from .tiles import cut_into_tiles, row_ranges

FRAGMENTS_PER_LAUNCH = 1 << 20  # 268 M pixel-splats, a third of a second on two cores, so a host can cancel in time


class SortedFrame:
    """Sorts one camera's view of staged splats once; each sample then blends one position within the pixels.

    Supersampling s needs s × s samples at the subpixels' centres, which makes the box filter in the film.
    """

    def __init__(self, shot: Shot) -> None:
        view, buffers = shot.view, shot.buffers
        self._subpixels = shot.settings.supersampling
        self.sample_count = self._subpixels**2
        self.points = 0
        self.warnings: tuple[str, ...] = ()
        self._view, self._timer = view, shot.timer
        staging = shot.stage()
        self.splats_visible = staging.count
        with shot.timer.stage("order"):
            self._ordered = sort_by_depth(staging, view, shot.settings.small_splat_px, buffers)
        with shot.timer.stage("tiles"):
            self._tiles = cut_into_tiles(self._ordered, staging.count, view, buffers)
        self._blends = buffers.array("blends", wp.int64, blend_counter_count(self._tiles, buffers.device))
        self._blends.zero_()
        self._row_ranges = row_ranges(self._tiles, FRAGMENTS_PER_LAUNCH)

    @property
    def blends(self) -> int:
        """Pixel-splat pairs evaluated so far."""
        return int(self._blends.numpy().sum())

    def render_sample(self, sample: int, film: Film, checkpoint: Callable[[], None]) -> None:
        """Add subpixel number `sample` of every pixel to the film."""
        s = self._subpixels
        sampling = Sampling()
        sampling.offset_px = wp.vec2((sample % s + 0.5) / s, (sample // s % s + 0.5) / s)
        sampling.corner = self._view.window_low
        sampling.alpha_max = self._view.alpha_max
        sampling.width, sampling.height = film.width, film.height
        sampling.columns = self._tiles.columns
        with self._timer.stage("blend"):
            for first, last in self._row_ranges:
                checkpoint()
                blend_tiles(self._ordered, self._tiles, first, last, sampling, film, self._blends)
        film.samples += 1
