# SPDX-License-Identifier: GPL-3.0-or-later
"""Every array on the device is allocated here, grown here and freed here."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import warp as wp

from .device import free_bytes
from .errors import StippleError
from .memory import gibibytes

GROWTH = 1.25  # a buffer that must grow takes a quarter more, so a slowly rising count does not reallocate each frame


def shortage(device: wp.Device, needed: int, what: str, free: int) -> str:
    """What to tell a user when memory does not suffice."""
    return (
        f"{device.alias}: {gibibytes(needed)} are needed for {what} and {gibibytes(free)} are free; "
        "render fewer splats, a smaller picture or a lower supersampling, or choose another device."
    )


class Buffers:
    """Named arrays on one device that are kept from frame to frame.

    `array` returns a view of the first `count` elements of the named buffer and grows it where it is too short; a
    grown buffer has lost its contents. `peak_bytes` is the most that was held at once.
    """

    def __init__(self, device: wp.Device) -> None:
        self.device = device
        self.peak_bytes = 0
        self._arrays: dict[str, wp.array] = {}

    def array(self, name: str, dtype: Any, count: int) -> wp.array:
        """Uninitialised elements 0 … count - 1 of buffer `name`. Raises StippleError when memory runs out."""
        held = self._arrays.get(name)
        if held is None or held.size < count or held.dtype != dtype:
            self._arrays.pop(name, None)
            grown = max(count, 1) if held is None else max(count, int(held.size * GROWTH), 1)
            del held
            held = self._arrays[name] = self._allocate(name, dtype, grown)
            self.peak_bytes = max(self.peak_bytes, self.held_bytes)
        return held[:count]

    def check(self, needs: Mapping[str, int], what: str) -> None:
        """Raise StippleError unless the named buffers fit together [bytes each], less what each of them already holds.

        For what will certainly be allocated: a CPU's memory is only taken when it is first written, so one buffer's
        own check does not see the one before.
        """
        held = {name: array.capacity for name, array in self._arrays.items()}
        needed = sum(size for name, size in needs.items() if size > held.get(name, 0))
        free = free_bytes(self.device)
        if needed > free:
            raise StippleError(shortage(self.device, needed, what, free))

    @property
    def held_bytes(self) -> int:
        return sum(array.capacity for array in self._arrays.values())

    def free(self) -> None:
        self._arrays.clear()

    def _allocate(self, name: str, dtype: Any, count: int) -> wp.array:
        needed, free = count * wp.types.type_size_in_bytes(dtype), free_bytes(self.device)
        message = shortage(self.device, needed, name, free)
        if needed > free:
            raise StippleError(message)
        try:
            return wp.empty(count, dtype=dtype, device=self.device)
        except (MemoryError, RuntimeError) as error:
            raise StippleError(message) from error
