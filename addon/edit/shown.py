# SPDX-License-Identifier: GPL-3.0-or-later
"""What an edited capture shows: deleted splats are in no picture, hidden and selected ones count while editing.

Edits of a linked capture are found and applied here, too.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from ...engine.capture_file import CaptureFile
from ...engine.edit.state_bits import DELETED
from ...engine.scene import Instance, SplatStates
from ..linked_capture import is_linked
from ..linked_edits import edited_capture, found_edits
from ..sequence import plays
from ..splat_data import states_of, usable_rows
from .mode import MARK
from .preview import preview_of
from .solid import seen_flags

Shown = tuple[tuple[Instance, ...], str]
"""What stands for an instance, and a notice for the user; "" for none."""


def shown_in_render(instance: Instance, b_object: Any, dropped: int) -> Shown:
    """An instance of an evaluated capture as a final render has it; `dropped` splats were left out of its cloud.

    Raises StippleError where the edits of a linked capture cannot be had: without them it is another picture.
    """
    return _shown(instance, b_object, dropped, DELETED)


def shown_in_viewport(instance: Instance, b_object: Any, dropped: int, b_scene: Any) -> Shown:
    """As `shown_in_render` for viewports, where what is edited shows what is hidden and selected, and what a modal
    operator has not written yet."""
    seen = seen_flags(getattr(b_object.original, MARK), b_scene.stipple_edit.show_highlight)
    preview = preview_of(b_object)
    if preview is not None:
        return preview.instances(instance, seen), ""
    return _shown(instance, b_object, dropped, seen)


def _shown(instance: Instance, b_object: Any, dropped: int, seen: int) -> Shown:
    if plays(b_object):
        return (instance,), ""
    if is_linked(b_object.data):
        found = found_edits(b_object.data, b_object.name) if isinstance(instance.cloud, CaptureFile) else None
        if found is None or not isinstance(instance.cloud, CaptureFile):
            return (instance,), ""
        return edited_capture(instance.cloud, found.edits).instances(instance, seen), found.notice
    states = states_of(b_object.data)
    if states is None:
        return (instance,), ""
    states &= np.uint32(seen)
    if dropped:
        states = states[usable_rows(b_object.data, b_object.name)]
    return (replace(instance, states=SplatStates(states) if states.any() else None),), ""
