# SPDX-License-Identifier: GPL-3.0-or-later
"""Every array on the device is allocated here, grown here and freed here."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import warp as wp

from .device import free_bytes
from .errors import DeviceError
from .memory import gibibytes

GROWTH = 1.25  # a buffer that must grow takes a quarter more, so a slowly rising count does not reallocate each frame

allocation_limits: dict[str, int] = {}
"""Most that the buffers of a renderer may hold [bytes], by the name its device was asked for. Empty but in tests."""


RENDER_LESS = "render fewer splats, a smaller picture or a lower supersampling, or choose another device"


def shortage(device: wp.Device, needed: int, what: str, free: int, remedy: str = RENDER_LESS) -> str:
    """What to tell a user when memory does not suffice."""
    return f"{device.alias}: {gibibytes(needed)} are needed for {what} and {gibibytes(free)} are free; {remedy}."


def allocate(
    device: wp.Device,
    dtype: Any,
    shape: int | tuple[int, ...],
    what: str,
    remedy: str = RENDER_LESS,
    free: int | None = None,
) -> wp.array:
    """An uninitialised array. Raises DeviceError, with `what` it was for, when memory does not suffice.

    `free` is less memory than the device has [bytes], where there is a limit.
    """
    count = math.prod(shape) if isinstance(shape, tuple) else shape
    needed = count * wp.types.type_size_in_bytes(dtype)
    free = free_bytes(device) if free is None else free
    message = shortage(device, needed, what, free, remedy)
    if needed > free:
        raise DeviceError(message)
    try:
        return wp.empty(shape, dtype=dtype, device=device)
    except (MemoryError, RuntimeError) as error:
        raise DeviceError(message) from error


class Buffers:
    """Named arrays on one device that are kept from frame to frame.

    `array` returns a view of the first `count` elements of the named buffer and grows it where it is too short; a
    grown buffer has lost its contents. `peak_bytes` is the most that was held at once.
    """

    def __init__(self, device: wp.Device, limit: int | None = None) -> None:
        """`limit` [bytes] is less memory than the device has."""
        self.device = device
        self._limit = limit
        self.peak_bytes = 0
        self._arrays: dict[str, wp.array] = {}

    def array(self, name: str, dtype: Any, count: int) -> wp.array:
        """Uninitialised elements 0 … count - 1 of buffer `name`. Raises DeviceError when memory runs out."""
        held = self._arrays.get(name)
        if held is None or held.size < count or held.dtype != dtype:
            self._arrays.pop(name, None)
            grown = max(count, 1) if held is None else max(count, int(held.size * GROWTH), 1)
            del held
            held = self._arrays[name] = allocate(self.device, dtype, grown, name, free=self.free_bytes)
            self.peak_bytes = max(self.peak_bytes, self.held_bytes)
        return held[:count]

    def check(self, needs: Mapping[str, int], what: str) -> None:
        """Raise DeviceError unless the named buffers fit together [bytes each], less what each of them already holds.

        For what will certainly be allocated: a CPU's memory is only taken when it is first written, so one buffer's
        own check does not see the one before.
        """
        held = self.bytes_by_name()
        needed = sum(size for name, size in needs.items() if size > held.get(name, 0))
        free = self.free_bytes
        if needed > free:
            raise DeviceError(shortage(self.device, needed, what, free))

    @property
    def held_bytes(self) -> int:
        return sum(self.bytes_by_name().values())

    def bytes_by_name(self) -> dict[str, int]:
        """What each buffer holds [bytes]."""
        return {name: array.capacity for name, array in self._arrays.items()}

    @property
    def free_bytes(self) -> int:
        """What can still be allocated [bytes]."""
        free = free_bytes(self.device)
        return free if self._limit is None else max(0, min(free, self._limit - self.held_bytes))

    def free(self) -> None:
        self._arrays.clear()
