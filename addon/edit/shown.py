# SPDX-License-Identifier: GPL-3.0-or-later
"""Which flags of an edit a picture shows: deleted splats are in none, hidden and selected ones count while editing."""

from __future__ import annotations

from typing import Any

import numpy as np

from ...engine.edit.state_bits import DELETED, HIDDEN, LOCKED, SELECTED
from ...engine.scene import SplatStates
from ..linked_capture import is_linked
from ..sequence import plays
from ..splat_data import states_of, usable_rows
from .mode import MARK


def states_in_render(b_object: Any, dropped: int) -> SplatStates | None:
    """The flags of an evaluated capture for a final render; `dropped` of its splats were left out of the cloud."""
    return _states(b_object, dropped, DELETED)


def states_in_viewport(b_object: Any, dropped: int, b_scene: Any) -> SplatStates | None:
    """As `states_in_render` for viewports, where what is edited shows what is hidden and selected."""
    seen = DELETED
    if getattr(b_object.original, MARK):
        seen |= HIDDEN | LOCKED
        if b_scene.stipple_edit.show_highlight:
            seen |= SELECTED
    return _states(b_object, dropped, seen)


def _states(b_object: Any, dropped: int, seen: int) -> SplatStates | None:
    states = states_of(b_object.data)
    if states is None or is_linked(b_object.data) or plays(b_object):  # these show other splats than the points
        return None
    states &= np.uint32(seen)
    if dropped:
        states = states[usable_rows(b_object.data, b_object.name)]
    return SplatStates(states) if states.any() else None
