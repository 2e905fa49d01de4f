# SPDX-License-Identifier: GPL-3.0-or-later
"""The machine that was measured: what it is, its memory bandwidth and its rate of atomic minima at random places."""

from __future__ import annotations

import platform
import resource
import statistics
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import warp as wp

from stipple.engine import device as engine_device
from stipple.engine.device import launch
from stipple.engine.maths.random import pcg3d

wp.set_module_options({"enable_backward": False})

COPIED = 1 << 24  # elements of 16 bytes, far larger than any cache
FRAME_WORDS = 1920 * 1080  # the framebuffer that atomics hit
MINIMA_PER_THREAD = 64
REPEATS = 5

# The instructions with which `points.splat` takes a word down.
MINIMUM_NATIVE = """
    unsigned long long* word = (unsigned long long*)&frame.data[at];
#ifdef __CUDA_ARCH__
    if (*word > value) atomicMin(word, (unsigned long long)value);
#else
    unsigned long long seen = __atomic_load_n(word, __ATOMIC_RELAXED);
    while (seen > value &&
           !__atomic_compare_exchange_n(word, &seen, value, true, __ATOMIC_RELAXED, __ATOMIC_RELAXED)) {}
#endif
"""


@wp.func_native(MINIMUM_NATIVE)
def take_down(frame: wp.array(dtype=wp.uint64), at: wp.int32, value: wp.uint64) -> None: ...


@wp.kernel
def copy_kernel(first: wp.int32, source: wp.array(dtype=wp.vec4ui), target: wp.array(dtype=wp.vec4ui)) -> None:
    i = first + wp.tid()
    target[i] = source[i]


@wp.kernel
def minima_kernel(first: wp.int32, frame: wp.array(dtype=wp.uint64)) -> None:
    thread = first + wp.tid()
    for k in range(MINIMA_PER_THREAD):
        bits = pcg3d(wp.vec3ui(wp.uint32(thread), wp.uint32(k), wp.uint32(1)))
        at = int(bits[0] % wp.uint32(frame.shape[0]))
        take_down(frame, at, (wp.uint64(bits[1]) << wp.uint64(32)) | wp.uint64(bits[2]))


def machine(device: wp.Device) -> dict[str, Any]:
    return {
        "device": device.name,
        "processor": processor_name(),
        "threads": engine_device.thread_count(),
        "python": platform.python_version(),
        "warp": wp.__version__,
        "system": platform.platform(),
    }


def processor_name() -> str:
    table = Path("/proc/cpuinfo")
    if table.exists():
        for line in table.read_text().splitlines():
            if line.startswith("model name"):
                return line.split(":", 1)[1].strip()
    return platform.processor()


def measured_rates(device: wp.Device) -> dict[str, float]:
    """Bytes copied (read and written) per second, atomic minima per second; on a CPU also per core second."""
    source = wp.zeros(COPIED, dtype=wp.vec4ui, device=device)
    target = wp.zeros(COPIED, dtype=wp.vec4ui, device=device)
    frame = wp.zeros(FRAME_WORDS, dtype=wp.uint64, device=device)
    threads = 1 << 18
    copied = _rate(lambda: launch(copy_kernel, COPIED, [source, target], device), 32.0 * COPIED, device)

    def minima() -> None:
        frame.fill_(0xFFFFFFFFFFFFFFFF)
        launch(minima_kernel, threads, [frame], device)

    lowered = _rate(minima, float(threads * MINIMA_PER_THREAD), device)
    rates = {"copy_bytes_per_second": copied[0], "atomic_minima_per_second": lowered[0]}
    if not device.is_cuda:
        rates |= {"copy_bytes_per_core_second": copied[1], "atomic_minima_per_core_second": lowered[1]}
    return rates


def _rate(work: Callable[[], None], amount: float, device: wp.Device) -> tuple[float, float]:
    """Per wall second and per core second, the medians of REPEATS runs after one that warms up."""
    wall, core = [], []
    for _ in range(REPEATS + 1):
        wp.synchronize_device(device)
        begin, begin_core = time.perf_counter(), time.process_time()
        work()
        wp.synchronize_device(device)
        wall.append(amount / (time.perf_counter() - begin))
        core.append(amount / max(time.process_time() - begin_core, 1e-9))
    return statistics.median(wall[1:]), statistics.median(core[1:])


def peak_process_bytes() -> int:
    """The most that this process ever held in the host's memory."""
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return int(peak if sys.platform == "darwin" else 1024 * peak)


def p95(values: list[float]) -> float:
    return float(np.sort(values)[min(len(values) - 1, int(0.95 * len(values)))])
