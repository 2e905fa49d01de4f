# SPDX-License-Identifier: GPL-3.0-or-later
"""The device: which one, how to launch on all of it, how much memory it has left.

Warp runs a CPU launch on one thread but lets go of the interpreter while it runs, so `launch` cuts a launch into
chunks for a pool of threads (2 threads: 2.0×, measured). Every Stipple kernel therefore takes `first` as its first
argument and works on element `first + wp.tid()`.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor, wait
from typing import Any, TypeVar

import warp as wp

from .errors import Cancelled, DeviceError
from .giving_way import interruption, lower_priority
from .memory import host_free_bytes

CHUNKS_PER_THREAD = 4  # evens out chunks of unequal work
SMALLEST_CHUNK = 1024  # elements; a smaller launch is not worth a thread (a launch costs some 20 µs)

_cpu = {"threads": max(1, len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1)}


Item, Result = TypeVar("Item"), TypeVar("Result")

_pools: dict[tuple[int, bool], ThreadPoolExecutor] = {}  # by threads and whether they give way


def set_thread_count(count: int) -> None:
    """Use `count` threads for CPU launches from now on. Never changes a picture."""
    _cpu["threads"] = max(1, count)


def thread_count() -> int:
    return _cpu["threads"]


def _pool(threads: int) -> ThreadPoolExecutor:
    key = threads, interruption() is not None
    if key not in _pools:
        start = lower_priority if key[1] else None
        _pools[key] = ThreadPoolExecutor(threads, thread_name_prefix="stipple", initializer=start)
    return _pools[key]


def close_pools() -> None:
    """End all worker threads; the next launch starts new ones."""
    while _pools:
        _pools.popitem()[1].shutdown(wait=True)


def choose_device(name: str = "auto") -> wp.Device:
    """The Warp device for "auto" (CUDA where there is one), "cpu", "cuda" or "cuda:N".

    Raises DeviceError when the machine has no such device.
    """
    wp.config.log_level = wp.LOG_ERROR  # its greeting and kernel loads would land among the results
    wp.init()
    if name == "auto":
        return wp.get_device("cuda:0" if wp.is_cuda_available() else "cpu")
    try:
        return wp.get_device("cuda:0" if name == "cuda" else name)
    except Exception as error:
        have = ", ".join(["cpu", *(device.alias for device in wp.get_cuda_devices())])
        raise DeviceError(f"device {name!r} is not on this machine; choose one of {have} or auto.") from error


def is_cpu(name: str) -> bool:
    """Whether `choose_device` answers this name with the CPU."""
    return name == "cpu" or (name == "auto" and not choose_device(name).is_cuda)


def launch(
    kernel: wp.Kernel,
    count: int,
    inputs: Sequence[Any],
    device: wp.Device,
    *,
    smallest_chunk: int = SMALLEST_CHUNK,
    block_dim: int = 256,
) -> None:
    """Run `kernel` for elements 0 … count - 1 with `inputs` after its `first` argument.

    On a CPU the elements are shared among `thread_count()` threads in consecutive chunks, so a kernel must not
    depend on the order of its elements. Inside `giving_way` they have a low priority, and Cancelled is raised when it
    is interrupted. On CUDA it is one launch and returns at once.
    """
    if count <= 0:
        return
    if device.is_cuda:
        wp.launch(kernel, dim=count, inputs=[0, *inputs], device=device, block_dim=block_dim)
        return
    threads = min(thread_count(), -(-count // smallest_chunk))
    if threads == 1:
        wp.launch(kernel, dim=count, inputs=[0, *inputs], device=device)
        return
    # Loaded here, or every thread would compile it.
    wp.load_module(kernel.module, device=device)
    chunk = max(smallest_chunk, -(-count // (threads * CHUNKS_PER_THREAD)))

    interrupted = interruption()

    def run(first: int) -> bool:
        if interrupted is not None and interrupted():
            return False
        wp.launch(kernel, dim=min(chunk, count - first), inputs=[first, *inputs], device=device)
        return True

    pool = _pool(threads)
    running = [pool.submit(run, begin) for begin in range(0, count, chunk)]
    try:
        done = [part.result() for part in running]
    except BaseException:  # KeyboardInterrupt among them, while threads go on in arrays that the caller will free
        for part in running:
            part.cancel()
        wait(running)
        raise
    if not all(done):
        raise Cancelled


def map_on_threads(function: Callable[[Item], Result], items: Sequence[Item]) -> list[Result]:
    """`function` of every item, in order, on `thread_count()` threads: for work that lets go of the interpreter."""
    if thread_count() == 1 or len(items) < 2:
        return [function(item) for item in items]
    return list(_pool(thread_count()).map(function, items))


def free_bytes(device: wp.Device) -> int:
    """Memory that can still be allocated on `device` [bytes]; a large number where the system does not tell."""
    return int(device.free_memory) if device.is_cuda else host_free_bytes()
