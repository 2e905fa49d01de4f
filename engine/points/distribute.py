# SPDX-License-Identifier: GPL-3.0-or-later
"""Give every thread its splat: work distribution by two scans and a scatter (§3.2, Fig. 2).

The paper scatters splat indices to where their points begin and takes an inclusive *maximum* scan. Warp scans sums, so
the splats that throw points are compacted into runs, a 1 is scattered to each run's beginning, and an inclusive sum
gives the run's number. The result is the same.

The unit is a batch: up to 16 consecutive points of one splat on a CPU (one vector register's lanes), up to K on CUDA.
Where the paper loses points beyond its bound T, here the batches are served in as many passes as it takes.
"""

from __future__ import annotations

from dataclasses import dataclass

import warp as wp

from ..buffers import Buffers
from ..device import launch

wp.set_module_options({"enable_backward": False})


@wp.struct
class Work:
    """Which splat each batch of the current pass belongs to."""

    counts: wp.array(dtype=wp.int32)  # points per staged splat
    end_batch: wp.array(dtype=wp.int64)  # per staged splat, inclusive prefix sum of batches
    staged_from_run: wp.array(dtype=wp.int32)
    run_from_batch: wp.array(dtype=wp.int32)  # of this pass, counted from 1 at run `first_run`
    first_run: wp.array(dtype=wp.int32)  # one element: the run that batch `begin` belongs to
    begin: wp.int64  # batch at which this pass begins


@dataclass(frozen=True)
class Distribution:
    """One sample's work, before it is cut into passes."""

    work: Work
    batch_count: int
    run_count: int


@wp.func
def first_batch(work: Work, staged: wp.int32) -> wp.int64:
    """The number of a staged splat's first batch: where the batches of those before it end."""
    if staged == 0:
        return wp.int64(0)
    return work.end_batch[staged - 1]


@wp.kernel
def compact_runs_kernel(
    first: wp.int32,
    end_run: wp.array(dtype=wp.int32),  # inclusive prefix sum of runs
    staged_from_run: wp.array(dtype=wp.int32),
) -> None:
    i = first + wp.tid()
    run = int(0)
    if i > 0:
        run = end_run[i - 1]
    if end_run[i] != run:
        staged_from_run[run] = i


@wp.kernel
def mark_runs_kernel(first: wp.int32, work: Work, end: wp.int64, total: wp.int64, run_count: wp.int32) -> None:
    run = first + wp.tid()
    start = first_batch(work, work.staged_from_run[run])
    stop = total
    if run + 1 < run_count:
        stop = first_batch(work, work.staged_from_run[run + 1])
    if stop <= work.begin or start >= end:
        return
    if start <= work.begin:
        work.first_run[0] = run
    work.run_from_batch[wp.max(start - work.begin, wp.int64(0))] = 1


def distribute(counts: wp.array, batches: wp.array, runs: wp.array, buffers: Buffers) -> Distribution:
    """Prefix sums, in place of `batches` and `runs`, and compaction. Reads back two totals (the launch sizes)."""
    wp.utils.array_scan(batches, batches, inclusive=True)
    wp.utils.array_scan(runs, runs, inclusive=True)
    batch_count, run_count = int(batches[-1:].numpy()[0]), int(runs[-1:].numpy()[0])
    work = Work()
    work.counts, work.end_batch = counts, batches
    work.staged_from_run = buffers.array("staged_from_run", wp.int32, run_count)
    launch(compact_runs_kernel, counts.size, [runs, work.staged_from_run], buffers.device)
    return Distribution(work, batch_count, run_count)


def distribute_pass(distribution: Distribution, begin: int, end: int, buffers: Buffers) -> Work:
    """Work for batches `begin` … `end` - 1 of the sample."""
    work = distribution.work
    work.begin = begin
    work.run_from_batch = buffers.array("run_from_batch", wp.int32, end - begin)
    work.first_run = buffers.array("first_run", wp.int32, 1)
    work.run_from_batch.zero_()
    inputs = [work, end, distribution.batch_count, distribution.run_count]
    launch(mark_runs_kernel, distribution.run_count, inputs, buffers.device)
    wp.utils.array_scan(work.run_from_batch, work.run_from_batch, inclusive=True)
    return work
