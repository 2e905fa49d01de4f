# SPDX-License-Identifier: GPL-3.0-or-later
"""How much memory the host has left, and how to speak of it; knows no device."""

from __future__ import annotations

import os
import sys
from pathlib import Path

NO_LIMIT = 1 << 62


def gibibytes(count: int) -> str:
    return f"{count / 2**30:.2f} GiB"


def byte_size(count: float) -> str:
    """Bytes as a person reads them, in powers of 1000."""
    units = ("B", "kB", "MB", "GB", "TB")
    exponent = 0
    while count >= 1000 and exponent < len(units) - 1:
        count, exponent = count / 1000, exponent + 1
    return f"{count:.0f} {units[0]}" if exponent == 0 else f"{count:.3g} {units[exponent]}"


def host_free_bytes() -> int:
    """What can still be allocated without pushing anything to disk [bytes]; a large number where no system tells."""
    if sys.platform == "linux":
        with open("/proc/meminfo") as table:
            for line in table:
                if line.startswith("MemAvailable:"):
                    return min(int(line.split()[1]) * 1024, _free_bytes_of_container())
    if sys.platform == "win32":
        return _free_bytes_windows()
    if hasattr(os, "sysconf") and "SC_PHYS_PAGES" in os.sysconf_names:
        return os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    return NO_LIMIT


def _free_bytes_of_container() -> int:
    """What a container or a farm's job may still take (cgroup version 2); a large number where there is no limit."""
    try:
        limit, used = (int(Path("/sys/fs/cgroup", name).read_text()) for name in ("memory.max", "memory.current"))
    except (OSError, ValueError):  # no such files, or "max"
        return NO_LIMIT
    return max(0, limit - used)


def _free_bytes_windows() -> int:
    import ctypes

    class MemoryStatus(ctypes.Structure):
        _fields_ = (
            ("length", ctypes.c_ulong),
            ("load", ctypes.c_ulong),
            *((name, ctypes.c_ulonglong) for name in ("total", "available", "a", "b", "c", "d", "e")),
        )

    status = MemoryStatus(length=ctypes.sizeof(MemoryStatus))
    ctypes.windll.kernel32.GlobalMemoryStatusEx(ctypes.byref(status))  # type: ignore[attr-defined]
    return int(status.available)
