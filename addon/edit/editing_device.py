# SPDX-License-Identifier: GPL-3.0-or-later
"""The device that edits run on, ready for them."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from .. import residency

if TYPE_CHECKING:
    import warp as wp


def editing_device(
    device: str, progress: Callable[[float, str], None] = lambda fraction, text: None, part: str = "edit"
) -> wp.Device:
    """The device for edits, the kernels of a method or "edit" loaded. Imports Warp; for the interface's thread.

    Waits for the viewports only while kernels are loaded: what edits launch after that runs beside them.
    Raises StippleError for a device that is not there.
    """
    if not residency.is_prepared(device, part):
        with residency.worker.final_render(lambda: None):
            residency.prepare(device, part, progress)
    from ...engine.device import choose_device

    return choose_device(device)
