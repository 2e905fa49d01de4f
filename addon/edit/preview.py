# SPDX-License-Identifier: GPL-3.0-or-later
"""What modal operators show in viewports before they write it: a session's splats in place of the datablock's."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy.typing as npt

from ...engine.edit.edited_capture import EditedCapture
from ...engine.scene import Instance, SplatStates
from ...engine.splats import SplatCloud

if TYPE_CHECKING:
    from .session import EditSession


@dataclass(frozen=True)
class Preview:
    """A cloud in memory under all of its flags."""

    cloud: SplatCloud
    states: SplatStates

    def instances(self, instance: Instance, seen: int) -> tuple[Instance, ...]:
        return (replace(instance, cloud=self.cloud, states=self.states),)


@dataclass(frozen=True)
class LinkedPreview:
    """A linked capture under edits that nobody has kept yet."""

    edited: EditedCapture

    def instances(self, instance: Instance, seen: int) -> tuple[Instance, ...]:
        return self.edited.instances(instance, seen)


_previews: dict[int, Preview | LinkedPreview] = {}  # by session_uid of the datablock


def show_preview(
    b_data: Any,
    session: EditSession,
    new_from_old: npt.ArrayLike | None = None,
    world_from_object: npt.ArrayLike | None = None,
) -> None:
    """Lets viewports show a session's splats in place of the datablock's; `new_from_old` is a drag's, in the world."""
    _previews[b_data.session_uid] = session.preview(new_from_old, world_from_object)


def end_preview(b_data: Any) -> None:
    _previews.pop(b_data.session_uid, None)


def preview_of(b_object: Any) -> Preview | LinkedPreview | None:
    """What to show in place of an evaluated object's data, if anything; never of what modifiers have changed."""
    if not _previews or len(b_object.modifiers):
        return None
    return _previews.get(b_object.original.data.session_uid)


def shown_previews() -> tuple[int, ...]:
    """Changes whenever a preview does."""
    return tuple(map(id, _previews.values()))
