# SPDX-License-Identifier: GPL-3.0-or-later
"""Named stage timers, so that a profile reads like the source."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager

import warp as wp


class StageTimer:
    """Sums wall seconds per stage.

    With `synchronise` every stage waits for the device, which makes CUDA times true and the whole frame slower;
    without, CUDA stages only show what launching them cost. On a CPU both are the same.
    """

    def __init__(self, device: wp.Device, synchronise: bool = False) -> None:
        self._device, self._synchronise = device, synchronise
        self.seconds: dict[str, float] = {}

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        begin = time.perf_counter()
        yield
        if self._synchronise:
            wp.synchronize_device(self._device)
        self.seconds[name] = self.seconds.get(name, 0.0) + time.perf_counter() - begin
