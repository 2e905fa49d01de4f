# SPDX-License-Identifier: GPL-3.0-or-later
"""Draw each splat's number of points for one sample: Poisson with rate λ (§3.3), so that points of a splat form a
Poisson point process and the chance of none at a subpixel is exactly one minus its opacity.
"""

from __future__ import annotations

import warp as wp

from ..buffers import Buffers
from ..device import launch
from ..maths.poisson import poisson
from ..maths.projection import View
from ..maths.random import pcg3d, uniform_open
from ..staging import Staged, Staging
from .rates import FILLED, support_box

wp.set_module_options({"enable_backward": False})

STRETCH = wp.constant(4096)  # counts that one thread adds up
COUNT_KEY = wp.constant(wp.uint32(0xFFFFFFFF))  # the counter of a splat's count; points count from 0


@wp.func
def round_to_multiple(count: wp.int32, multiple: wp.int32, u: wp.float32) -> wp.int32:
    """Stochastically, with the right mean (§3.4, parameter K)."""
    whole = count / multiple
    if u * float(multiple) <= float(count - whole * multiple):
        whole += 1
    return whole * multiple


@wp.kernel
def draw_counts_kernel(
    first: wp.int32,
    staged: Staged,
    view: View,
    rates: wp.array(dtype=wp.float32),
    stream: wp.array(dtype=wp.uint32),
    subpixels: wp.int32,
    points_per_thread: wp.int32,
    batch: wp.int32,
    counts: wp.array(dtype=wp.int32),
    batches: wp.array(dtype=wp.int64),
    runs: wp.array(dtype=wp.int32),
) -> None:
    i = first + wp.tid()
    rate = rates[i]
    count = int(0)
    if rate == FILLED:
        low, high = view.window_low, view.window_high
        box = support_box(view, staged.covariance[i], staged.centre[i], low, high, subpixels)
        count = box[2] * box[3]
    elif rate > 0.0:
        bits = pcg3d(wp.vec3ui(wp.uint32(staged.splat[i]), stream[staged.instance[i]], COUNT_KEY))
        u = wp.vec3(uniform_open(bits[0]), uniform_open(bits[1]), uniform_open(bits[2]))
        count = poisson(rate, u)
        if points_per_thread > 1:
            count = round_to_multiple(count, points_per_thread, u[2])
    counts[i] = count
    batches[i] = wp.int64((count + batch - 1) / batch)
    runs[i] = wp.where(count > 0, 1, 0)


@wp.kernel
def add_stretches_kernel(first: wp.int32, counts: wp.array(dtype=wp.int32), totals: wp.array(dtype=wp.int64)) -> None:
    stretch = first + wp.tid()
    total = wp.int64(0)
    for i in range(stretch * STRETCH, wp.min((stretch + 1) * STRETCH, counts.shape[0])):
        total += wp.int64(counts[i])
    totals[stretch] = total


def total_of(counts: wp.array, buffers: Buffers) -> int:
    """The sum of all counts, read back."""
    stretches = -(-counts.size // STRETCH)
    totals = buffers.array("count_totals", wp.int64, stretches)
    launch(add_stretches_kernel, stretches, [counts, totals], buffers.device, smallest_chunk=16)
    return int(totals.numpy().sum())


def draw_counts(
    staging: Staging,
    view: View,
    rates: wp.array,
    stream: wp.array,
    subpixels: int,
    points_per_thread: int,
    batch: int,
    buffers: Buffers,
) -> tuple[wp.array, wp.array, wp.array]:
    """Per staged splat: its points, the batches of `batch` points they fill, and 1 where there are any."""
    counts = buffers.array("counts", wp.int32, staging.count)
    batches = buffers.array("batches", wp.int64, staging.count)
    runs = buffers.array("runs", wp.int32, staging.count)
    inputs = [staging.arrays, view, rates, stream, subpixels, points_per_thread, batch, counts, batches, runs]
    launch(draw_counts_kernel, staging.count, inputs, buffers.device)
    return counts, batches, runs
