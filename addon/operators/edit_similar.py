# SPDX-License-Identifier: GPL-3.0-or-later
"""Select from a splat under the cursor, or from the selection: what hangs together, what has the same color."""

from __future__ import annotations

from typing import Any

import bpy
import numpy as np
from bpy.props import BoolProperty, FloatProperty, FloatVectorProperty, IntProperty

from ...engine.errors import StippleError
from ...engine.splats import SH_C0
from ..edit.mode import Reported
from ..edit.operator import session_in, world_from_object
from ..edit.session import EditSession
from .edit_paint import pick_under
from .edit_select import MatchOperator

FROM_SELECTION = -1


class STIPPLE_OT_select_linked(MatchOperator, bpy.types.Operator):
    """Select what hangs together with the splat under the cursor, or with the selection"""

    bl_idname = "stipple.select_linked"
    bl_label = "Select Linked Splats"
    splat: IntProperty(  # type: ignore[valid-type]
        name="Splat", description="Where it begins; -1 for the selection", default=FROM_SELECTION, min=FROM_SELECTION
    )
    distance: FloatProperty(  # type: ignore[valid-type]
        name="Distance", description="Of one step, in typical distances between splats", default=2.0, min=0.01
    )
    threshold: FloatProperty(  # type: ignore[valid-type]
        name="Color Threshold", description="Stay where the color is so similar; 1 for any", default=1.0, min=0, max=1
    )
    under_cursor: BoolProperty(default=True, options={"HIDDEN", "SKIP_SAVE"})  # type: ignore[valid-type]

    def invoke(self, context: Any, event: Any) -> set[str]:
        if not self.under_cursor or context.region_data is None:
            return self.execute(context)
        with Reported(self):
            self.by_hand = True
            found = pick_under(context, event)
            if found is None:
                raise StippleError("Select Linked: there is no splat under the cursor.")
            self.splat = found.splat
            return self.execute(context)
        return {"CANCELLED"}

    def match(self, context: Any, session: EditSession) -> Any:
        from ...engine.edit.mask import mask_from_numpy
        from ...engine.edit.match_values import match_colour
        from ...engine.edit.neighbours import match_connected, typical_spacing
        from ...engine.edit.selection import selected_or_refuse

        cloud, placed = session.cloud, world_from_object(context)
        if self.splat == FROM_SELECTION:
            seeds = selected_or_refuse(cloud, "grow from")
        elif self.splat < cloud.splat_count:
            seeds = mask_from_numpy(np.arange(cloud.splat_count) == self.splat, cloud.device)
        else:
            raise StippleError(f"Select Linked: there is no splat {self.splat}; the last is {cloud.splat_count - 1}.")
        within = None
        if self.threshold < 1.0:
            colour = base_colours(session)[seeds.numpy()].mean(axis=0)
            within = match_colour(cloud, colour, self.threshold)
        return match_connected(cloud, seeds, self.distance * typical_spacing(cloud, 6, placed), placed, within)


class STIPPLE_OT_select_color(MatchOperator, bpy.types.Operator):
    """Select splats whose color is similar to that under the cursor"""

    bl_idname = "stipple.select_color"
    bl_label = "Select Splats by Color"
    color: FloatVectorProperty(  # type: ignore[valid-type]
        name="Color",
        description="Color to look for",
        size=3,
        subtype="COLOR_GAMMA",
        default=(0.5, 0.5, 0.5),
        min=0,
        max=1,
    )
    threshold: FloatProperty(  # type: ignore[valid-type]
        name="Threshold", description="Largest difference, as it is seen", default=0.1, min=0.0, soft_max=1.0
    )

    def invoke(self, context: Any, event: Any) -> set[str]:
        if context.region_data is None:
            return self.execute(context)
        with Reported(self):
            self.by_hand = True
            found = pick_under(context, event)
            if found is None:
                raise StippleError("Select by Color: there is no splat under the cursor.")
            self.color = np.clip(base_colours(session_in(context, self.by_hand))[found.splat], 0, 1)
            return self.execute(context)
        return {"CANCELLED"}

    def match(self, context: Any, session: EditSession) -> Any:
        from ...engine.edit.match_values import match_colour

        return match_colour(session.cloud, tuple(self.color), self.threshold)


def base_colours(session: EditSession) -> np.ndarray:
    """Colours without view dependence (N, 3), sRGB-encoded."""
    return 0.5 + SH_C0 * session.cloud.host("sh_dc")


CLASSES = (STIPPLE_OT_select_linked, STIPPLE_OT_select_color)

register, unregister = bpy.utils.register_classes_factory(CLASSES)
