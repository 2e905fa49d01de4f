# SPDX-License-Identifier: GPL-3.0-or-later
"""Which properties of an object or datablock Blender sets at each frame: by keys, strips or drivers."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any


def curves_of(b_owner: Any) -> Iterator[Any]:
    """The F-curves of an owner's action, if it has any."""
    b_animation = b_owner.animation_data
    if b_animation and b_animation.action:
        yield from slot_curves(b_animation.action, b_animation.action_slot)


def animated_paths(b_owner: Any) -> set[str]:
    """Data paths of everything that keys, strips of the Nonlinear Animation or drivers set."""
    b_animation = b_owner.animation_data
    if not b_animation:
        return set()
    b_curves = [*curves_of(b_owner), *b_animation.drivers]
    for b_track in b_animation.nla_tracks:
        for b_strip in b_track.strips:
            if b_strip.action:
                b_curves += slot_curves(b_strip.action, b_strip.action_slot)
    return {b_curve.data_path for b_curve in b_curves if not b_curve.mute}


def slot_curves(b_action: Any, b_slot: Any) -> Iterator[Any]:
    """The F-curves of one slot of an action; of no slot none."""
    for b_layer in b_action.layers:
        for b_strip in b_layer.strips:
            b_bag = b_strip.channelbag(b_slot) if b_slot else None
            if b_bag:
                yield from b_bag.fcurves
