# SPDX-License-Identifier: GPL-3.0-or-later
"""A paint stroke: a ball that moves through the capture and leaves colour, or opacity, on the splats it meets.

What a stroke has put on a splat so far is kept as one 16-bit coverage, and the splat's colour is worked out from that
and from what it was before the stroke. So overlapping dabs do not add up (each splat gets the strongest dab it met)
unless the brush builds up, dabs may come in any order and number, and the weakest falloff is not lost to rounding.
"""

from __future__ import annotations

from typing import Any

import numpy.typing as npt
import warp as wp

from ..buffers import allocate
from ..device import launch
from .affine import Affine, checked, composed, device_affine, mapped
from .brush import OPACITY, Brush, DeviceBrush, device_brush, falloff_at, painted
from .editable_cloud import EditableCloud
from .mask import EDIT_LESS, Mask, has_bit, mask_from_hits
from .match_space import unit_ball_from_world
from .paint_layer import (
    OpacityDiff,
    PaintDiff,
    begin_colour_layer,
    begin_opacity_layer,
    show_harmonics,
    show_harmonics_of,
)
from .paint_word import painted_dc
from .rows import as_columns, copy_rows, no_rows
from .step import Step
from .under_brush import BLOCK_CPU, under_brush

wp.set_module_options({"enable_backward": False})

FULL = wp.constant(65535.0)


@wp.func
def coverage_after(
    brush: DeviceBrush,
    unit_from_object: Affine,
    i: wp.int32,
    position: wp.array(dtype=wp.vec3),
    state: wp.array(dtype=wp.uint32),
    limit: wp.array(dtype=wp.uint32),
    coverage: wp.array(dtype=wp.uint16),
) -> wp.int32:
    """What a dab makes of a splat's coverage, 0 … 65535; -1 where it leaves it as it is."""
    if (state[i] & brush.blocked) != wp.uint32(0):
        return -1
    p = mapped(unit_from_object, position[i])
    square = wp.dot(p, p)
    if not square <= 1.0:
        return -1
    if brush.limited != 0 and not has_bit(limit, i):
        return -1
    amount = int(wp.floor(FULL * brush.strength * falloff_at(brush.falloff, wp.sqrt(square)) + 0.5))
    before = int(coverage[i])
    after = wp.max(before, amount)
    if brush.build_up != 0:
        # At least one step, so that a weak airbrush arrives in the end.
        left = 65535 - before
        after = before + wp.min(left, int(wp.ceil(float(left) * float(amount) / FULL)))
    return wp.where(after > before, after, -1)


@wp.kernel
def dab_colour_kernel(
    first: wp.int32,
    block_size: wp.int32,
    brush: DeviceBrush,
    unit_from_object: Affine,
    position: wp.array(dtype=wp.vec3),
    state: wp.array(dtype=wp.uint32),
    limit: wp.array(dtype=wp.uint32),
    coverage: wp.array(dtype=wp.uint16),
    before: wp.array(dtype=wp.uint64),  # words at the stroke's start, where coverage is not 0
    base_dc: wp.array(dtype=wp.vec3),
    paint: wp.array(dtype=wp.uint64),
    sh_dc: wp.array(dtype=wp.vec3),
    base_rest: wp.array2d(dtype=wp.vec3),
    sh_rest: wp.array2d(dtype=wp.vec3),  # without columns: harmonics follow later
) -> None:
    begin = (first + wp.tid()) * block_size
    count = wp.min(block_size, position.shape[0] - begin)
    found = under_brush(unit_from_object, position, state, brush.blocked, begin, count)
    i = begin
    while found != wp.uint64(0):
        if (found & wp.uint64(1)) != wp.uint64(0):
            after = coverage_after(brush, unit_from_object, i, position, state, limit, coverage)
            if after >= 0:
                if coverage[i] == wp.uint16(0):
                    before[i] = paint[i]
                coverage[i] = wp.uint16(after)
                word = painted(brush, before[i], base_dc[i], float(after) / FULL)
                paint[i] = word
                sh_dc[i] = painted_dc(word, base_dc[i])
                show_harmonics_of(i, word, base_dc, base_rest, sh_rest)
        found = found >> wp.uint64(1)
        i += 1


@wp.kernel
def unpaint_colour_kernel(
    first: wp.int32,
    coverage: wp.array(dtype=wp.uint16),
    before: wp.array(dtype=wp.uint64),
    base_dc: wp.array(dtype=wp.vec3),
    paint: wp.array(dtype=wp.uint64),
    sh_dc: wp.array(dtype=wp.vec3),
    base_rest: wp.array2d(dtype=wp.vec3),
    sh_rest: wp.array2d(dtype=wp.vec3),
) -> None:
    i = first + wp.tid()
    if coverage[i] != wp.uint16(0):
        paint[i] = before[i]
        sh_dc[i] = painted_dc(before[i], base_dc[i])
        show_harmonics_of(i, before[i], base_dc, base_rest, sh_rest)


@wp.kernel
def unpaint_opacity_kernel(
    first: wp.int32,
    coverage: wp.array(dtype=wp.uint16),
    before: wp.array(dtype=wp.float32),
    opacity: wp.array(dtype=wp.float32),
) -> None:
    i = first + wp.tid()
    if coverage[i] != wp.uint16(0):
        opacity[i] = before[i]


@wp.kernel
def dab_opacity_kernel(
    first: wp.int32,
    block_size: wp.int32,
    brush: DeviceBrush,
    unit_from_object: Affine,
    position: wp.array(dtype=wp.vec3),
    state: wp.array(dtype=wp.uint32),
    limit: wp.array(dtype=wp.uint32),
    coverage: wp.array(dtype=wp.uint16),
    before: wp.array(dtype=wp.float32),
    base_opacity: wp.array(dtype=wp.float32),
    opacity: wp.array(dtype=wp.float32),
) -> None:
    begin = (first + wp.tid()) * block_size
    count = wp.min(block_size, position.shape[0] - begin)
    found = under_brush(unit_from_object, position, state, brush.blocked, begin, count)
    i = begin
    while found != wp.uint64(0):
        if (found & wp.uint64(1)) != wp.uint64(0):
            after = coverage_after(brush, unit_from_object, i, position, state, limit, coverage)
            if after >= 0:
                if coverage[i] == wp.uint16(0):
                    before[i] = opacity[i]
                coverage[i] = wp.uint16(after)
                target = wp.where(brush.mode == OPACITY, brush.opacity, base_opacity[i])
                if after == 65535:
                    opacity[i] = target
                else:
                    amount = float(after) / FULL
                    opacity[i] = (1.0 - amount) * before[i] + amount * target
        found = found >> wp.uint64(1)
        i += 1


@wp.kernel
def covered_kernel(first: wp.int32, coverage: wp.array(dtype=wp.uint16), hits: wp.array(dtype=wp.uint8)) -> None:
    i = first + wp.tid()
    hits[i] = wp.uint8(wp.where(coverage[i] != wp.uint16(0), 1, 0))


@wp.kernel
def changed_kernel(
    first: wp.int32,
    coverage: wp.array(dtype=wp.uint16),
    before: wp.array2d(dtype=wp.uint32),
    now: wp.array2d(dtype=wp.uint32),
    hits: wp.array(dtype=wp.uint8),
) -> None:
    i = first + wp.tid()
    hit = int(0)
    if coverage[i] != wp.uint16(0):
        for k in range(before.shape[1]):
            if before[i, k] != now[i, k]:
                hit = 1
    hits[i] = wp.uint8(hit)


class PaintStroke:
    """One stroke of a brush: it shows with every dab and becomes one step.

    `dab` paints; `finish` returns the step, its changes already made, for `History.record`, or None where nothing was
    painted; `cancel` takes every bit back. Paints splats that are shown and unlocked, of `within` only if given.

    Raises StippleError when memory runs out; nothing is painted then.
    """

    def __init__(
        self,
        cloud: EditableCloud,
        brush: Brush,
        world_from_object: npt.ArrayLike | None = None,
        within: Mask | None = None,
        name: str = "Paint",
    ) -> None:
        self._cloud, self._name = cloud, name
        self._world_from_object = checked(world_from_object, "world_from_object")
        self._paints_colour = "opacity" not in brush.mode
        self._brush = device_brush(brush, limited=within is not None)
        self._limit = within.words if within is not None else wp.empty(0, dtype=wp.uint32, device=cloud.device)
        if self._paints_colour:
            begin_colour_layer(cloud)
        else:
            begin_opacity_layer(cloud)
        self._target = "paint" if self._paints_colour else "opacity"
        now = cloud.writable(self._target)
        self._coverage = allocate(cloud.device, wp.uint16, cloud.splat_count, "a paint stroke", EDIT_LESS)
        self._coverage.zero_()
        # Written where the brush first meets a splat, so that a small stroke touches little of it.
        self._before = allocate(cloud.device, now.dtype, cloud.splat_count, "a paint stroke", EDIT_LESS)
        self._stale = False  # harmonics that do not follow the paint yet
        self._no_rest = wp.empty((0, 0), dtype=wp.vec3, device=cloud.device)

    def dab(self, centre: npt.ArrayLike, radius: float, harmonics: bool = True) -> None:
        """Paint the ball of `radius` about `centre` (3,), in world units.

        Without `harmonics` the view-dependent colour follows only at the end of the stroke: for brushes that cover
        millions of splats of high degree. Raises StippleError for a ball that is none.
        """
        unit_from_object = composed(unit_ball_from_world(centre, radius), self._world_from_object)
        cloud = self._cloud
        inputs = [self._brush, device_affine(unit_from_object), cloud.array("position"), cloud.state, self._limit]
        inputs += [self._coverage, self._before]
        if self._paints_colour:
            self._launch(dab_colour_kernel, inputs + self._colour_arrays(harmonics))
            self._stale |= not harmonics
            cloud.touched("paint", "sh_dc", *(["sh_rest"] if harmonics else []))
        else:
            inputs += [cloud.array(name) for name in ("base_opacity", "opacity")]
            self._launch(dab_opacity_kernel, inputs)
            cloud.touched("opacity")

    def show_harmonics(self) -> None:
        """Let the view-dependent colour of all splats painted so far follow the paint."""
        if self._stale and self._cloud.has("base_rest"):
            hits = self._cloud.hits()
            launch(covered_kernel, self._cloud.splat_count, [self._coverage, hits], self._cloud.device)
            show_harmonics(self._cloud, mask_from_hits(hits, self._cloud.splat_count).indices())
        self._stale = False

    def finish(self) -> Step | None:
        """The whole stroke as a step. Where memory runs out the stroke is taken back and StippleError goes on."""
        try:
            self.show_harmonics()
            cloud, now = self._cloud, self._cloud.array(self._target)
            hits = cloud.hits()
            inputs = [self._coverage, as_columns(self._before), as_columns(now), hits]
            launch(changed_kernel, cloud.splat_count, inputs, cloud.device)
            rows = mask_from_hits(hits, cloud.splat_count).indices()
            held = allocate(cloud.device, now.dtype, rows.size, "the undo of a stroke", EDIT_LESS)
        except BaseException:
            self.cancel()
            raise
        copy_rows(rows.size, rows, {"held": self._before}, no_rows(cloud.device), {"held": held})
        diff = (PaintDiff if self._paints_colour else OpacityDiff)(rows, held)
        return Step(self._name, (diff,), int(rows.size)) if rows.size else None

    def cancel(self) -> None:
        """Put everything back as it was before the stroke."""
        cloud = self._cloud
        if self._paints_colour:
            inputs = [self._coverage, self._before, *self._colour_arrays(True)]
            launch(unpaint_colour_kernel, cloud.splat_count, inputs, cloud.device)
            cloud.touched("paint", "sh_dc", "sh_rest")
        else:
            inputs = [self._coverage, self._before, cloud.array("opacity")]
            launch(unpaint_opacity_kernel, cloud.splat_count, inputs, cloud.device)
            cloud.touched("opacity")
        self._coverage.zero_()

    def _launch(self, kernel: wp.Kernel, inputs: list[Any]) -> None:
        """Run a dab's kernel, which takes a block of splats at a time."""
        cloud = self._cloud
        size = 1 if cloud.device.is_cuda else BLOCK_CPU
        launch(kernel, -(-cloud.splat_count // size), [size, *inputs], cloud.device, smallest_chunk=64)

    def _colour_arrays(self, harmonics: bool) -> list[wp.array]:
        arrays = [self._cloud.array(name) for name in ("base_dc", "paint", "sh_dc")]
        if harmonics and self._cloud.has("base_rest"):
            return [*arrays, self._cloud.array("base_rest"), self._cloud.array("sh_rest")]
        return [*arrays, self._no_rest, self._no_rest]
