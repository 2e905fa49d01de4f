# SPDX-License-Identifier: GPL-3.0-or-later
"""Select all, none, the rest, more, less; delete and restore, hide and reveal, lock and unlock."""

from __future__ import annotations

from typing import Any

import bpy
from bpy.props import BoolProperty, EnumProperty, FloatProperty

from ..edit.operator import SplatOperator, world_from_object
from ..edit.session import EditSession

ACTIONS = (
    ("TOGGLE", "Toggle", "Select all, or nothing if something is selected"),
    ("SELECT", "Select", "Select all that is shown and unlocked"),
    ("DESELECT", "Deselect", "Select nothing"),
    ("INVERT", "Invert", "Select what is not selected"),
)
ENGINE_ACTIONS = {"SELECT": "all", "DESELECT": "none", "INVERT": "invert"}


class STIPPLE_OT_select_all(SplatOperator, bpy.types.Operator):
    """Select all splats, none, or the others"""

    bl_idname = "stipple.select_all"
    bl_label = "(De)select All Splats"
    action: EnumProperty(name="Action", description="What becomes of the selection", items=ACTIONS, default="TOGGLE")  # type: ignore[valid-type]

    def step(self, context: Any, session: EditSession) -> Any:
        from ...engine.edit.selection import select_all

        action = self.action
        if action == "TOGGLE":
            action = "DESELECT" if session.cloud.selection().count() else "SELECT"
        return select_all(session.cloud, ENGINE_ACTIONS[action])


class SpreadOperator(SplatOperator):
    """Selects or deselects by nearness."""

    distance: FloatProperty(  # type: ignore[valid-type]
        name="Distance", description="In typical distances between splats", default=2.0, min=0.01, soft_max=20.0
    )

    def of_spacing(self, context: Any, session: EditSession) -> float:
        """The distance in world units: `distance` times the capture's typical spacing."""
        from ...engine.edit.neighbours import typical_spacing

        return self.distance * typical_spacing(session.cloud, world_from_object=world_from_object(context))


class STIPPLE_OT_select_more(SpreadOperator, bpy.types.Operator):
    """Also select what is near the selection"""

    bl_idname = "stipple.select_more"
    bl_label = "Select More Splats"

    def step(self, context: Any, session: EditSession) -> Any:
        from ...engine.edit.neighbours import grow

        return grow(session.cloud, self.of_spacing(context, session), world_from_object(context))


class STIPPLE_OT_select_less(SpreadOperator, bpy.types.Operator):
    """Deselect what is near the rest"""

    bl_idname = "stipple.select_less"
    bl_label = "Select Less Splats"

    def step(self, context: Any, session: EditSession) -> Any:
        from ...engine.edit.neighbours import shrink

        return shrink(session.cloud, self.of_spacing(context, session), world_from_object(context))


class FlagOperator(SplatOperator):
    """Flips a flag: `function` is what does it in `engine.edit.flags`."""

    function: str

    def step(self, context: Any, session: EditSession) -> Any:
        from ...engine.edit import flags

        return getattr(flags, self.function)(session.cloud)


class FlagOfSelection(SplatOperator):
    """As `FlagOperator`, of what is selected or what is not."""

    function: str
    unselected: BoolProperty(  # type: ignore[valid-type]
        name="Unselected", description="Those that are not selected instead", default=False
    )

    def step(self, context: Any, session: EditSession) -> Any:
        from ...engine.edit import flags

        return getattr(flags, self.function)(session.cloud, self.unselected)


class STIPPLE_OT_delete(SplatOperator, bpy.types.Operator):
    """Delete the selected splats; until Edit Splats is left they can be restored"""

    bl_idname = "stipple.delete"
    bl_label = "Delete Splats"
    unselected: BoolProperty(  # type: ignore[valid-type]
        name="Unselected", description="Delete what is not selected and keep the selection", default=False
    )

    def step(self, context: Any, session: EditSession) -> Any:
        from ...engine.edit.flags import delete, keep_only

        return keep_only(session.cloud) if self.unselected else delete(session.cloud)


class STIPPLE_OT_restore(FlagOperator, bpy.types.Operator):
    """Bring back all splats deleted since Edit Splats was entered"""

    bl_idname = "stipple.restore"
    bl_label = "Restore Deleted Splats"
    function = "restore"


class STIPPLE_OT_hide(FlagOfSelection, bpy.types.Operator):
    """Hide the selected splats while editing"""

    bl_idname = "stipple.hide"
    bl_label = "Hide Splats"
    function = "hide"


class STIPPLE_OT_reveal(SplatOperator, bpy.types.Operator):
    """Show all hidden splats"""

    bl_idname = "stipple.reveal"
    bl_label = "Reveal Splats"
    select: BoolProperty(  # type: ignore[valid-type]
        name="Select", description="Select what is revealed, or else leave it unselected", default=True
    )

    def step(self, context: Any, session: EditSession) -> Any:
        from ...engine.edit.flags import reveal

        return reveal(session.cloud, self.select)


class STIPPLE_OT_lock(FlagOfSelection, bpy.types.Operator):
    """Protect the selected splats from every edit"""

    bl_idname = "stipple.lock"
    bl_label = "Lock Splats"
    function = "lock"


class STIPPLE_OT_unlock(FlagOperator, bpy.types.Operator):
    """Let all locked splats be edited again"""

    bl_idname = "stipple.unlock"
    bl_label = "Unlock Splats"
    function = "unlock"


CLASSES = (
    STIPPLE_OT_select_all,
    STIPPLE_OT_select_more,
    STIPPLE_OT_select_less,
    STIPPLE_OT_delete,
    STIPPLE_OT_restore,
    STIPPLE_OT_hide,
    STIPPLE_OT_reveal,
    STIPPLE_OT_lock,
    STIPPLE_OT_unlock,
)

register, unregister = bpy.utils.register_classes_factory(CLASSES)
