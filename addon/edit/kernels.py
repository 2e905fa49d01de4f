# SPDX-License-Identifier: GPL-3.0-or-later
"""Kernels of edits, loaded beside the interface: the first time on a computer they are compiled, which takes a while.

Entering Edit Splats begins it. Until it is done the status bar says how far it is, and what a key or a click begins is
refused with the same words. Scripts wait, and so does the background: there is no interface to freeze.
"""

from __future__ import annotations

import logging
import threading
from contextlib import AbstractContextManager

import bpy

from ...engine.errors import Cancelled, StippleError
from .. import residency

PARTS = ("edit", "sorted", "points")  # the edits, what is under the cursor, what is seen
SAY_INTERVAL = 0.2  # [s]
log = logging.getLogger(__package__)

_saying: list[str] = []  # how far it is, as long as it goes on
_failed: set[str] = set()  # devices: who needs one next meets the error
_stopping = threading.Event()
_threads: list[threading.Thread] = []  # at most one


def is_ready(device: str) -> bool:
    """Whether every edit on a device begins at once."""
    return all(residency.is_prepared(device, part) for part in PARTS)


def begin(device: str) -> None:
    """Loads the kernels in a thread of their own, unless they are loaded or being loaded; returns at once."""
    if is_ready(device) or device in _failed or (_threads and _threads[0].is_alive()):
        return
    _saying[:] = ["Edit Splats: preparing kernels, slow only the first time"]
    _stopping.clear()
    _threads[:] = [threading.Thread(target=_load, args=(device,), name="stipple-edit-kernels", daemon=True)]
    _threads[0].start()
    bpy.app.timers.register(_tell, persistent=True)


def check_ready(device: str) -> None:
    """For what a key or a click begins. Raises StippleError while kernels are loaded, which begins here if need be."""
    if not bpy.app.background:
        begin(device)
    if _saying:
        raise StippleError(f"{_saying[0]}. Try again in a moment.")


def stop() -> None:
    """Ends the loading after the module it is at."""
    _stopping.set()
    while _threads:
        _threads.pop().join()


def _load(device: str) -> None:
    try:
        for part in PARTS:
            residency.prepare(device, part, _say, _turn)
    except Cancelled:
        pass
    except Exception:
        log.exception("Kernels of edits could not be loaded")
        _failed.add(device)
    finally:
        _saying.clear()


def _say(fraction: float, text: str) -> None:
    if fraction > 0:
        _saying[:] = [f"Edit Splats: {text}"]


def _turn() -> AbstractContextManager[None]:
    """One module at a time, so that viewports go on between them."""
    return residency.worker.final_render(_go_on)


def _go_on() -> None:
    if _stopping.is_set():
        raise Cancelled


def _tell() -> float | None:
    for b_window in bpy.context.window_manager.windows:
        b_window.workspace.status_text_set(_saying[0] if _saying else None)
    return SAY_INTERVAL if _saying else None


def register() -> None: ...


def unregister() -> None:
    stop()
    _failed.clear()
