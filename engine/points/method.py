# SPDX-License-Identifier: GPL-3.0-or-later
"""One sample of *points*, stage by stage."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import warp as wp

from ..buffers import Buffers
from ..film import Film
from ..maths.random import stream_key
from ..shot import Shot
from .counts import draw_counts
from .distribute import distribute, distribute_pass
from .rates import find_rates
from .resolve import resolve_points
from .splat import BATCH_CPU, splat_points

BATCHES_PER_LAUNCH = 1 << 19  # some 8 M points: a quarter of a second on two cores, so a host can cancel in time


class PointsFrame:
    """Renders samples of one camera's view of staged splats."""

    def __init__(self, shot: Shot) -> None:
        settings, buffers = shot.settings, shot.buffers
        self.sample_count = settings.samples
        self.points = 0
        self.warnings: tuple[str, ...] = ()
        self._staging, self._view, self._settings = shot.stage(), shot.view, settings
        self.splats_visible = self._staging.count
        self._instance_count, self._buffers, self._timer = len(shot.clouds), buffers, shot.timer
        # On a CPU a batch is a register of lanes; counts were already rounded to multiples of K.
        self._batch = settings.points_per_thread if buffers.device.is_cuda else BATCH_CPU
        with shot.timer.stage("rates"):
            self._rates = find_rates(self._staging, self._view, settings.supersampling, buffers)

    @property
    def blends(self) -> int:
        """None: points do not blend."""
        return 0

    def render_sample(self, sample: int, film: Film, checkpoint: Callable[[], None]) -> None:
        """Add sample number `sample` to the film; `checkpoint` is called between launches and may raise."""
        settings, buffers, timer = self._settings, self._buffers, self._timer
        s = settings.supersampling
        frame = buffers.array("visibility", wp.uint64, film.width * film.height * s * s)
        with timer.stage("clear"):
            frame.fill_(0xFFFFFFFFFFFFFFFF)
        if self._staging.count:
            self._throw(sample, frame, checkpoint)
        with timer.stage("resolve"):
            resolve_points(self._staging.arrays, self._view, s, frame, film)

    def _throw(self, sample: int, frame: wp.array, checkpoint: Callable[[], None]) -> None:
        settings, buffers, timer, staging = self._settings, self._buffers, self._timer, self._staging
        keys = [stream_key(settings.seed, sample, instance) for instance in range(self._instance_count)]
        stream = buffers.array("stream", wp.uint32, self._instance_count)
        stream.assign(np.array(keys, np.uint32))
        s, k = settings.supersampling, settings.points_per_thread
        with timer.stage("counts"):
            drawn = draw_counts(staging, self._view, self._rates, stream, s, k, self._batch, buffers)
        with timer.stage("distribute"):
            distribution = distribute(*drawn, buffers)
        batches_in_flight = max(1, settings.max_points // self._batch)
        if distribution.batch_count > batches_in_flight:
            passes = -(-distribution.batch_count // batches_in_flight)
            self.warnings = (
                f"points: a sample needs more than max_points = {settings.max_points} at once and is rendered in "
                f"{passes} passes; nothing is lost, a larger max_points is faster.",
            )
        step = min(batches_in_flight, BATCHES_PER_LAUNCH) if not buffers.device.is_cuda else batches_in_flight
        for begin in range(0, distribution.batch_count, step):
            checkpoint()
            with timer.stage("distribute"):
                end = min(begin + step, distribution.batch_count)
                work = distribute_pass(distribution, begin, end, buffers)
            with timer.stage("splat"):
                splat_points(
                    staging.arrays, self._view, work, self._rates, stream, s, self._batch, frame, buffers.device
                )
        self.points += _sum(drawn[0], buffers)


def _sum(counts: wp.array, buffers: Buffers) -> int:
    total = buffers.array("point_total", wp.int64, counts.size)
    wp.utils.array_cast(counts, total)
    wp.utils.array_scan(total, total, inclusive=True)
    return int(total[-1:].numpy()[0])
