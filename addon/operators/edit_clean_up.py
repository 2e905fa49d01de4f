# SPDX-License-Identifier: GPL-3.0-or-later
"""Clean-up filters: each selects or deletes what a scan has too much of; the redo panel says how much that is."""

from __future__ import annotations

from typing import Any

import bpy
from bpy.props import EnumProperty, FloatProperty, IntProperty, StringProperty

from ..edit.operator import SplatOperator, world_from_object
from ..edit.session import EditSession
from .edit_select import box_of

ACTIONS = (
    ("SELECT", "Select", "Select what is found"),
    ("DELETE", "Delete", "Delete what is found"),
)


class CleanUpOperator(SplatOperator):
    """Subclasses find in `found`."""

    action: EnumProperty(  # type: ignore[valid-type]
        name="Action", description="What is done with the splats that are found", items=ACTIONS, default="SELECT"
    )
    count: IntProperty(name="Found", options={"HIDDEN", "SKIP_SAVE"})  # type: ignore[valid-type]

    def step(self, context: Any, session: EditSession) -> Any:
        from ...engine.edit.flags import delete
        from ...engine.edit.selection import select

        found = self.found(context, session)
        self.count = found.count()
        self.report({"INFO"}, f"{self.count:,} of {session.cloud.splat_count:,} splats found.")  # type: ignore[attr-defined]
        return delete(session.cloud, found) if self.action == "DELETE" else select(session.cloud, found)

    def found(self, context: Any, session: EditSession) -> Any:
        raise NotImplementedError

    def draw(self, context: Any) -> None:
        layout = self.layout  # type: ignore[attr-defined]
        layout.use_property_split = True
        for name in ("factor", "neighbours", "size", "opacity", "object"):
            if name in self.rna_type.properties:  # type: ignore[attr-defined]
                layout.prop(self, name)
        layout.prop(self, "action", expand=True)
        layout.label(text=f"{self.count:,} splats found", icon="INFO")


class STIPPLE_OT_clean_floaters(CleanUpOperator, bpy.types.Operator):
    """Find splats that float alone, far from others"""

    bl_idname = "stipple.clean_floaters"
    bl_label = "Floaters"
    factor: FloatProperty(  # type: ignore[valid-type]
        name="Distance", description="In typical distances between splats", default=4.0, min=0.1, soft_max=50.0
    )
    neighbours: IntProperty(  # type: ignore[valid-type]
        name="Neighbors", description="So many others must be within the distance", default=6, min=1, max=32
    )

    def found(self, context: Any, session: EditSession) -> Any:
        from ...engine.edit.clean_up import find_floaters

        return find_floaters(session.cloud, self.factor, self.neighbours, world_from_object(context))


class STIPPLE_OT_clean_oversized(CleanUpOperator, bpy.types.Operator):
    """Find splats that are too large"""

    bl_idname = "stipple.clean_oversized"
    bl_label = "Oversized"
    size: FloatProperty(  # type: ignore[valid-type]
        name="Size",
        description="Longest standard deviation that is not too large",
        default=0.5,
        min=0.0,
        subtype="DISTANCE",
    )

    def found(self, context: Any, session: EditSession) -> Any:
        from ...engine.edit.clean_up import find_oversized

        return find_oversized(session.cloud, self.size, world_from_object(context))


class STIPPLE_OT_clean_faint(CleanUpOperator, bpy.types.Operator):
    """Find splats that are nearly transparent"""

    bl_idname = "stipple.clean_faint"
    bl_label = "Nearly Transparent"
    opacity: FloatProperty(  # type: ignore[valid-type]
        name="Opacity", description="Least opacity that is not too faint", default=0.05, min=0.0, max=1.0
    )

    def found(self, context: Any, session: EditSession) -> Any:
        from ...engine.edit.clean_up import find_faint

        return find_faint(session.cloud, self.opacity)


class STIPPLE_OT_clean_outside(CleanUpOperator, bpy.types.Operator):
    """Find splats outside the box of an object, as a crop takes it: an empty's as it is drawn, else the bounding box"""

    bl_idname = "stipple.clean_outside"
    bl_label = "Outside Box"
    object: StringProperty(name="Object", description="Object whose box is kept")  # type: ignore[valid-type]

    def found(self, context: Any, session: EditSession) -> Any:
        from ...engine.edit.clean_up import find_outside

        return find_outside(session.cloud, box_of(context, self.object), world_from_object(context))


CLASSES = (
    STIPPLE_OT_clean_floaters,
    STIPPLE_OT_clean_oversized,
    STIPPLE_OT_clean_faint,
    STIPPLE_OT_clean_outside,
)

register, unregister = bpy.utils.register_classes_factory(CLASSES)
