# SPDX-License-Identifier: GPL-3.0-or-later
"""Named stage timers, so that a profile reads like the source."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager

import warp as wp


class StageTimer:
    """Sums wall seconds and the process's core seconds per stage.

    With `synchronise` every stage waits for the device, which makes CUDA times true and the whole frame slower;
    without, CUDA stages only show what launching them cost. On a CPU both are the same.
    """

    def __init__(self, device: wp.Device, synchronise: bool = False) -> None:
        self._device, self._synchronise = device, synchronise
        self.seconds: dict[str, float] = {}
        self.core_seconds: dict[str, float] = {}  # over all threads; other work on the machine does not lengthen them

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        begin, begin_core = time.perf_counter(), time.process_time()
        yield
        if self._synchronise:
            wp.synchronize_device(self._device)
        self.seconds[name] = self.seconds.get(name, 0.0) + time.perf_counter() - begin
        self.core_seconds[name] = self.core_seconds.get(name, 0.0) + time.process_time() - begin_core
