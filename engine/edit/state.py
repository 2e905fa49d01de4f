# SPDX-License-Identifier: GPL-3.0-or-later
"""The state of a splat: one 32-bit word, one bit per flag (Splatshop, doi 10.1111/cgf.70214, §3.1).

A kernel reads four bytes to learn whether a splat concerns it, before an order of magnitude more. Flags are independent
of each other, so that an operation flips one flag (reveal and separate two) and its undo needs one bit per splat: a
splat that is deleted while selected stays marked as selected, counts as such for nobody (`acts`), and is so again when
restored.
"""

from __future__ import annotations

import warp as wp

from .state_bits import DELETED, HIDDEN, LOCKED, NOT_SELECTABLE, SELECTED, SEPARATED

__all__ = ["DELETED", "HIDDEN", "LOCKED", "NOT_SELECTABLE", "SELECTED", "SEPARATED", "acts", "selectable", "shown"]

wp.set_module_options({"enable_backward": False})

SELECTED_BIT = wp.constant(wp.uint32(SELECTED))
NOT_SHOWN_BITS = wp.constant(wp.uint32(HIDDEN | DELETED))
NOT_SELECTABLE_BITS = wp.constant(wp.uint32(NOT_SELECTABLE))


@wp.func
def shown(state: wp.uint32) -> wp.bool:
    """Whether a splat is drawn: neither hidden nor deleted."""
    return (state & NOT_SHOWN_BITS) == wp.uint32(0)


@wp.func
def selectable(state: wp.uint32) -> wp.bool:
    """Whether a splat may be selected and changed: shown and not locked."""
    return (state & NOT_SELECTABLE_BITS) == wp.uint32(0)


@wp.func
def acts(state: wp.uint32) -> wp.bool:
    """Whether an operation on the selection concerns a splat: selected and selectable. Also: draw it highlighted."""
    return (state & (NOT_SELECTABLE_BITS | SELECTED_BIT)) == SELECTED_BIT
