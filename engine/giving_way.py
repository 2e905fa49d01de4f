# SPDX-License-Identifier: GPL-3.0-or-later
"""Rendering in the background of an interface: threads that let it go first, and launches that end early.

An interface without a graphics card is drawn by the same cores that render. Threads of lower priority use every core
while the interface rests and next to nothing while it draws; a core that is kept free would be lost all the time.
"""

from __future__ import annotations

import os
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress

NICENESS = 10  # about a tenth of the time that a thread of usual priority gets beside it (Linux, EEVDF or CFS)
BELOW_NORMAL = -1  # THREAD_PRIORITY_BELOW_NORMAL of Windows
QOS_UTILITY = 0x11  # QOS_CLASS_UTILITY of macOS


class _Caller(threading.local):
    interrupted: Callable[[], bool] | None = None


_caller = _Caller()


@contextmanager
def giving_way(interrupted: Callable[[], bool]) -> Iterator[None]:
    """CPU launches of this thread run on threads of low priority, and end early once `interrupted()` is true.

    They end with Cancelled; what they wrote is unfinished then, and the film and its frame are of no more use.
    `interrupted` is called from several threads.
    """
    before, _caller.interrupted = _caller.interrupted, interrupted
    try:
        yield
    finally:
        _caller.interrupted = before


def interruption() -> Callable[[], bool] | None:
    """What `giving_way` was given; None outside it."""
    return _caller.interrupted


def lower_priority() -> None:
    """Lets other threads go before the calling one, where the system allows it; there is no way back."""
    with suppress(OSError, AttributeError):
        _lower_priority()


def _lower_priority() -> None:
    if sys.platform == "linux":
        thread = threading.get_native_id()
        os.setpriority(os.PRIO_PROCESS, thread, min(os.getpriority(os.PRIO_PROCESS, thread) + NICENESS, 19))
    elif sys.platform == "win32":
        import ctypes

        kernel = ctypes.WinDLL("kernel32")
        kernel.GetCurrentThread.restype = ctypes.c_void_p
        kernel.SetThreadPriority.argtypes = [ctypes.c_void_p, ctypes.c_int]
        kernel.SetThreadPriority(kernel.GetCurrentThread(), BELOW_NORMAL)
    elif sys.platform == "darwin":
        import ctypes

        ctypes.CDLL(None).pthread_set_qos_class_self_np(ctypes.c_uint(QOS_UTILITY), ctypes.c_int(0))
