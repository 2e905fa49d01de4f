# SPDX-License-Identifier: GPL-3.0-or-later
"""One sample of *points*, stage by stage.

Where there is room, what the camera sees is staged once and serves all samples. Larger scenes are staged anew for each
sample, slab by slab, so that working memory does not grow with the scene; there whole groups that others hide are left
out in two phases (`culling`), and colours are found at the end, for what was seen.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import warp as wp

from ..culling import Blocks, cull_groups
from ..film import Film
from ..maths.random import stream_key
from ..occlusion import SECOND_PHASE, Occlusion, front_to_back, hide_blocks, select_blocks
from ..shot import Shot
from ..staging import Staging, stage_blocks
from .counts import draw_counts, total_of
from .distribute import distribute, distribute_pass
from .rates import find_rates
from .resolve import Subpixels, resolve_records, resolve_splats
from .seen import mark_seen
from .splat import BATCH_CPU, splat_points

BATCHES_PER_LAUNCH = 1 << 19  # some 8 M points: a quarter of a second on two cores, so a host can cancel in time
# Scenes of up to so many splats in the frustum keep their records. Larger ones gain more by leaving out what is hidden
# (city: 4×) than they lose by staging each sample anew (where nothing is hidden: a tenth).
KEPT_SPLATS = 1 << 20
SLABS = 20  # larger ones work on a twentieth at a time, which is under 5 bytes per splat of the scene
SMALLEST_SLAB, LARGEST_SLAB = 1 << 20, 1 << 24  # splats


class PointsFrame:
    """Renders samples of one camera's view."""

    def __init__(self, shot: Shot) -> None:
        settings, buffers = shot.settings, shot.buffers
        self.sample_count = settings.samples
        self.points = 0
        self.splats_visible = 0
        self.warnings: tuple[str, ...] = ()
        self._shot, self._view, self._settings = shot, shot.view, settings
        self._buffers, self._timer = buffers, shot.timer
        # On a CPU a batch is a register of lanes; counts were already rounded to multiples of K.
        self._batch = settings.points_per_thread if buffers.device.is_cuda else BATCH_CPU
        self._kept: tuple[Staging, wp.array] | None = None
        with shot.timer.stage("cull"):
            bounded = settings.culling != "none"
            blocks = cull_groups(shot.placements, self._view, buffers, bounded=bounded)
        shift = shot.placements.group_shift
        if blocks.count << shift <= KEPT_SPLATS:
            with shot.timer.stage("stage"):
                staging = stage_blocks(shot.placements, self._view, Occlusion(), blocks, 0, blocks.count, buffers)
            self._kept = (staging, self._rates(staging))
            self.splats_visible = staging.count
        elif settings.culling == "occlusion":
            with shot.timer.stage("cull"):
                blocks = front_to_back(blocks, shot.placements, self._view, buffers)
        self._blocks = blocks
        slab = min(max(shot.placements.splat_count // SLABS, SMALLEST_SLAB), LARGEST_SLAB)
        self._blocks_per_slab = max(1, slab >> shift)

    @property
    def blends(self) -> int:
        """None: points do not blend."""
        return 0

    def render_sample(self, sample: int, film: Film, checkpoint: Callable[[], None]) -> None:
        """Add sample number `sample` to the film; `checkpoint` is called between launches and may raise."""
        s, placed = self._settings.supersampling, self._shot.placements.placed
        frame = self._buffers.array("visibility", wp.uint64, film.width * film.height * s * s)
        with self._timer.stage("clear"):
            frame.fill_(0xFFFFFFFFFFFFFFFF)
        subpixels = Subpixels()
        subpixels.words, subpixels.per_side, subpixels.columns = frame, s, film.width
        stream = self._streams(sample)
        if self._kept is not None:
            staging, rates = self._kept
            self._throw(staging, rates, stream, None, frame, checkpoint)
            with self._timer.stage("resolve"):
                resolve_records(staging.arrays, self._view, subpixels, film)
            return
        self.splats_visible = 0
        if self._settings.culling == "occlusion":
            self._throw_in_two_phases(stream, frame, (film.width, film.height), checkpoint)
        else:
            self._throw_slabs(self._blocks, Occlusion(), stream, frame, checkpoint)
        with self._timer.stage("resolve"):
            resolve_splats(placed, self._view, subpixels, film)

    def mark_seen(self, instance: int, film: Film, hits: wp.array) -> None:
        """Set the byte of each splat of an instance that the last sample showed somewhere; see `seen`."""
        words = self._buffers.array("visibility", wp.uint64, film.width * film.height * self._settings.supersampling**2)
        staged = self._kept[0].arrays if self._kept is not None else None
        mark_seen(words, staged, self._shot.placements.placed, instance, hits)

    def _streams(self, sample: int) -> wp.array:
        """Per instance the random stream of a sample."""
        count = self._shot.placements.instance_count
        keys = [stream_key(self._settings.seed, sample, instance) for instance in range(count)]
        stream = self._buffers.array("stream", wp.uint32, count)
        if count:
            stream.assign(np.array(keys, np.uint32))
        return stream

    def _rates(self, staging: Staging) -> wp.array:
        with self._timer.stage("rates"):
            return find_rates(staging, self._view, self._settings.supersampling, self._buffers)

    def _throw_in_two_phases(
        self, stream: wp.array, frame: wp.array, size: tuple[int, int], checkpoint: Callable[[], None]
    ) -> None:
        memory, placements, view = self._shot.occlusion_memory, self._shot.placements, self._view
        occlusion = memory.begin(size)

        def look() -> None:
            with self._timer.stage("pyramid"):
                memory.look(occlusion, frame, size, self._settings.supersampling, self._buffers)

        for phase in (occlusion.phase, SECOND_PHASE):
            occlusion.phase = phase
            with self._timer.stage("cull"):
                blocks = select_blocks(self._blocks, placements, view, occlusion, self._buffers)
            self._throw_slabs(blocks, occlusion, stream, frame, checkpoint, look)

    def _throw_slabs(
        self,
        blocks: Blocks,
        occlusion: Occlusion,
        stream: wp.array,
        frame: wp.array,
        checkpoint: Callable[[], None],
        look: Callable[[], None] | None = None,
    ) -> None:
        """Throw all blocks, a slab at a time; `look` at what has been drawn after each slab."""
        placements, view, buffers = self._shot.placements, self._view, self._buffers
        for begin in range(0, blocks.count, self._blocks_per_slab):
            checkpoint()
            end = min(begin + self._blocks_per_slab, blocks.count)
            if begin > 0 and look is not None:
                with self._timer.stage("cull"):
                    hide_blocks(blocks, begin, end, placements, view, occlusion.now, buffers.device)
            with self._timer.stage("stage"):
                staging = stage_blocks(placements, view, occlusion, blocks, begin, end, buffers, coloured=False)
            self.splats_visible += staging.count
            self._throw(staging, self._rates(staging), stream, placements.placed.first_splat, frame, checkpoint)
            if look is not None:
                look()

    def _throw(
        self,
        staging: Staging,
        rates: wp.array,
        stream: wp.array,
        first_splat: wp.array | None,
        frame: wp.array,
        checkpoint: Callable[[], None],
    ) -> None:
        """Throw the points of staged splats into `frame`."""
        if staging.count == 0:
            return
        settings, buffers, timer, view = self._settings, self._buffers, self._timer, self._view
        s, k = settings.supersampling, settings.points_per_thread
        with timer.stage("counts"):
            drawn = draw_counts(staging, view, rates, stream, s, k, self._batch, buffers)
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
                    staging.arrays, view, work, rates, stream, first_splat, s, self._batch, frame, buffers.device
                )
        self.points += total_of(drawn[0], buffers)
