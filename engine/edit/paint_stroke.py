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
from .affine import checked, composed, device_affine
from .brush import OPACITY, Brush, device_brush
from .cover import BLOCK_CPU, Dab, cover
from .editable_cloud import EditableCloud
from .mask import EDIT_LESS, Mask, mask_from_hits
from .match_space import unit_ball_from_world
from .paint_lanes import StrokeColours, paint_block
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

wp.set_module_options({"enable_backward": False})

FULL = wp.constant(65535.0)
OPACITY_MODE = wp.constant(OPACITY)


@wp.func
def bit(bits: wp.uint64, k: wp.int32) -> wp.bool:
    return (bits >> wp.uint64(k)) & wp.uint64(1) != wp.uint64(0)


@wp.kernel
def dab_colour_kernel(first: wp.int32, block_size: wp.int32, dab: Dab, colours: StrokeColours) -> None:
    begin = (first + wp.tid()) * block_size
    count = wp.min(block_size, dab.position.shape[0] - begin)
    bits = cover(dab, begin, count)
    if bits[0] != wp.uint64(0):
        paint_block(dab, bits, colours, begin, count)
        if colours.sh_rest.shape[1] > 0:
            for k in range(count):
                if bit(bits[0], k):
                    word = colours.paint[begin + k]
                    show_harmonics_of(begin + k, word, colours.base_dc, colours.base_rest, colours.sh_rest)


@wp.kernel
def unpaint_colour_kernel(first: wp.int32, coverage: wp.array(dtype=wp.uint16), colours: StrokeColours) -> None:
    i = first + wp.tid()
    if coverage[i] != wp.uint16(0):
        word = colours.before[i]
        colours.paint[i] = word
        colours.sh_dc[i] = painted_dc(word, colours.base_dc[i])
        show_harmonics_of(i, word, colours.base_dc, colours.base_rest, colours.sh_rest)


@wp.kernel
def dab_opacity_kernel(
    first: wp.int32,
    block_size: wp.int32,
    dab: Dab,
    before: wp.array(dtype=wp.float32),
    base_opacity: wp.array(dtype=wp.float32),
    opacity: wp.array(dtype=wp.float32),
) -> None:
    begin = (first + wp.tid()) * block_size
    count = wp.min(block_size, dab.position.shape[0] - begin)
    bits = cover(dab, begin, count)
    if bits[0] == wp.uint64(0):
        return
    for k in range(count):
        i = begin + k
        if bit(bits[0], k):
            if bit(bits[1], k):
                before[i] = opacity[i]
            target = wp.where(dab.brush.mode == OPACITY_MODE, dab.brush.opacity, base_opacity[i])
            if dab.coverage[i] == wp.uint16(65535):
                opacity[i] = target
            else:
                amount = float(dab.coverage[i]) / FULL
                opacity[i] = (1.0 - amount) * before[i] + amount * target


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


def has_paint(cloud: EditableCloud, opacity: bool = False) -> bool:
    """Whether any splat has another colour, or opacity, than an eraser brings back. Reads back."""
    cloud.array("opacity" if opacity else "sh_dc")  # of a capture in its file paint comes along with it
    if opacity:
        return cloud.has("base_opacity") and bool((cloud.host("opacity") != cloud.host("base_opacity")).any())
    return cloud.has("paint") and bool(cloud.array("paint").numpy().any())


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
        self._coverage = cloud.spare_array("coverage", wp.uint16)
        self._coverage.zero_()
        # Written where the brush first meets a splat, so that a small stroke touches little of it.
        self._before = cloud.spare_array(f"{self._target} before", now.dtype)
        self._over = False
        self._stale = False  # harmonics that do not follow the paint yet
        self._no_rest = wp.empty((0, 0), dtype=wp.vec3, device=cloud.device)

    def dab(self, centre: npt.ArrayLike, radius: float, harmonics: bool = True) -> None:
        """Paint the ball of `radius` about `centre` (3,), in world units.

        Without `harmonics` the view-dependent colour follows only at the end of the stroke: for brushes that cover
        millions of splats of high degree. Raises StippleError for a ball that is none.
        """
        unit_from_object = composed(unit_ball_from_world(centre, radius), self._world_from_object)
        cloud = self._cloud
        dab = Dab()
        dab.brush, dab.unit_from_object = self._brush, device_affine(unit_from_object)
        dab.position, dab.state, dab.limit = cloud.array("position"), cloud.state, self._limit
        dab.coverage = self._coverage
        if self._paints_colour:
            self._launch(dab_colour_kernel, [dab, self._colours(harmonics)])
            self._stale |= not harmonics
            cloud.touched("paint", "sh_dc", *(["sh_rest"] if harmonics else []))
        else:
            arrays = [cloud.array(name) for name in ("base_opacity", "opacity")]
            self._launch(dab_opacity_kernel, [dab, self._before, *arrays])
            cloud.touched("opacity")

    def show_harmonics(self) -> None:
        """Let the view-dependent colour of all splats painted so far follow the paint."""
        if self._stale and self._cloud.has("base_rest"):
            hits = self._cloud.hits()
            launch(covered_kernel, self._cloud.splat_count, [self._coverage, hits], self._cloud.device)
            show_harmonics(self._cloud, mask_from_hits(hits, self._cloud.splat_count).indices())
        self._stale = False

    def finish(self) -> Step | None:
        """The whole stroke as a step. Where memory runs out the stroke is taken back and StippleError goes on.

        Ends the stroke, as `cancel` does: nothing more can be done with it.
        """
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
        self._give_back()
        diff = (PaintDiff if self._paints_colour else OpacityDiff)(rows, held)
        return Step(self._name, (diff,), int(rows.size)) if rows.size else None

    def cancel(self) -> None:
        """Put everything back as it was before the stroke. Nothing, once it is over."""
        cloud = self._cloud
        if self._over:
            return
        if self._paints_colour:
            launch(unpaint_colour_kernel, cloud.splat_count, [self._coverage, self._colours(True)], cloud.device)
            cloud.touched("paint", "sh_dc", "sh_rest")
        else:
            inputs = [self._coverage, self._before, cloud.array("opacity")]
            launch(unpaint_opacity_kernel, cloud.splat_count, inputs, cloud.device)
            cloud.touched("opacity")
        self._give_back()

    def _give_back(self) -> None:
        """The next stroke takes the memory over: new memory costs more than a small dab in it."""
        self._cloud.spare |= {"coverage": self._coverage, f"{self._target} before": self._before}
        self._over = True

    def _launch(self, kernel: wp.Kernel, inputs: list[Any]) -> None:
        """Run a dab's kernel, which takes a block of splats at a time."""
        cloud = self._cloud
        size = 1 if cloud.device.is_cuda else BLOCK_CPU
        launch(kernel, -(-cloud.splat_count // size), [size, *inputs], cloud.device, smallest_chunk=64)

    def _colours(self, harmonics: bool) -> StrokeColours:
        cloud, colours = self._cloud, StrokeColours()
        colours.before = self._before
        for name in ("base_dc", "paint", "sh_dc"):
            setattr(colours, name, cloud.array(name))
        with_rest = harmonics and cloud.has("base_rest")
        for name in ("base_rest", "sh_rest"):
            setattr(colours, name, cloud.array(name) if with_rest else self._no_rest)
        return colours
