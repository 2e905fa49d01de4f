# SPDX-License-Identifier: GPL-3.0-or-later
"""Paint, erase and clone with a ball that rolls over what is seen."""

from __future__ import annotations

import time
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import bpy
import numpy as np
from bpy.props import BoolProperty, CollectionProperty, EnumProperty, FloatProperty, FloatVectorProperty

from ...engine.errors import StippleError
from ..edit.kernels import check_ready
from ..edit.mode import Reported, edited_object
from ..edit.operator import SplatOperator, device_of, redraw, session_in, world_from_object
from ..edit.properties import BRUSH_MODES, FALLOFFS
from ..edit.session import EditSession
from ..edit.stroke import StrokeOperator
from ..edit.visible import Picker
from ..linked_capture import is_linked

SLOW = 0.06  # [s] a dab; several of them come with a movement of the mouse
HARMONICS_COST = 3.2  # times a dab without: 1.9 to 3.1 for 1 to 28 M splats of degree 3 (EPYC, two cores)


class StippleDab(bpy.types.PropertyGroup):
    """One touch of a brush: a ball in the world."""

    location: FloatVectorProperty(subtype="XYZ_LENGTH")  # type: ignore[valid-type]
    radius: FloatProperty(default=0.1, min=0.0, subtype="DISTANCE")  # type: ignore[valid-type]


class BallStroke(StrokeOperator, SplatOperator):
    """Strokes of balls in the world; `stroke` holds them, so that redo panels and scripts can do one again."""

    def start(self, context: Any, session: EditSession) -> Any:
        """The engine's stroke."""
        raise NotImplementedError

    def begin(self, context: Any, session: EditSession, event: Any) -> None:
        self._picker = Picker.of_session(context, session, self.engine_camera)
        self.stroke.clear()  # type: ignore[attr-defined]
        self._engine_stroke: Any = None

    def dab(self, context: Any, session: EditSession, x: float, y: float) -> None:
        found = self._picker.pick(x, y)
        if found is None:
            return
        b_dab = self.stroke.add()  # type: ignore[attr-defined]
        b_dab.location = found.position_world
        b_dab.radius = self._picker.radius_at(found.position_world, self.brush_radius(context))
        if self._engine_stroke is None:
            self._engine_stroke = self.start(context, session)
        self.touch(self._engine_stroke, b_dab, shown=True)

    def touch(self, engine_stroke: Any, b_dab: Any, shown: bool) -> None:
        """Do one dab, which the user sees at once if `shown`."""
        engine_stroke.dab(tuple(b_dab.location), b_dab.radius)

    def finish(self, session: EditSession) -> Any:
        return None if self._engine_stroke is None else self._engine_stroke.finish()

    def cancel_stroke(self, session: EditSession) -> None:
        if self._engine_stroke is not None:
            self._engine_stroke.cancel()

    def execute(self, context: Any) -> set[str]:
        with Reported(self):
            session = session_in(context)
            if not len(self.stroke):  # type: ignore[attr-defined]
                raise StippleError(f"{self.bl_label}: the stroke has no dabs; give at least one.")  # type: ignore[attr-defined]
            engine_stroke = self.start(context, session)
            try:
                for b_dab in self.stroke:  # type: ignore[attr-defined]
                    self.touch(engine_stroke, b_dab, shown=False)
            except BaseException:
                engine_stroke.cancel()
                raise
            step = engine_stroke.finish()
            if step is not None and session.commit(edited_object(context).data, step, self.sources_of(step), done=True):
                redraw(context)
                return {"FINISHED"}
        return {"CANCELLED"}


class STIPPLE_OT_paint(BallStroke, bpy.types.Operator):
    """Paint splats, with the colors that depend on the view"""

    bl_idname = "stipple.paint"
    bl_label = "Paint Splats"
    stroke: CollectionProperty(type=StippleDab, options={"HIDDEN", "SKIP_SAVE"})  # type: ignore[valid-type]
    mode: EnumProperty(name="Blend", description="What the brush does", items=BRUSH_MODES, options={"SKIP_SAVE"})  # type: ignore[valid-type]
    color: FloatVectorProperty(  # type: ignore[valid-type]
        name="Color",
        description="Color to paint",
        size=3,
        subtype="COLOR_GAMMA",
        default=(1, 1, 1),
        min=0,
        max=1,
        options={"SKIP_SAVE"},
    )
    opacity: FloatProperty(  # type: ignore[valid-type]
        name="Opacity", description="Opacity to paint", default=1, min=0, max=1, options={"SKIP_SAVE"}
    )
    strength: FloatProperty(  # type: ignore[valid-type]
        name="Strength",
        description="How much the middle of the brush does",
        default=1,
        min=0,
        max=1,
        options={"SKIP_SAVE"},
    )
    falloff: EnumProperty(  # type: ignore[valid-type]
        name="Falloff", description="How the brush fades towards its edge", items=FALLOFFS, options={"SKIP_SAVE"}
    )
    build_up: BoolProperty(name="Accumulate", description="Let dabs of the stroke add up", options={"SKIP_SAVE"})  # type: ignore[valid-type]
    selected_only: BoolProperty(name="Selected Only", description="Paint only selected splats", options={"SKIP_SAVE"})  # type: ignore[valid-type]
    if TYPE_CHECKING:  # Blender must not see it
        _quick: bool | None  # whether harmonics are painted with every dab that shows; None before the first

    def begin(self, context: Any, session: EditSession, event: Any) -> None:
        """The brush is that of the tool's settings, where the caller asks for no other."""
        b_brush = context.scene.stipple_edit
        for name in ("color", "opacity", "strength", "falloff", "build_up", "selected_only"):
            if not self.properties.is_property_set(name):
                setattr(self, name, getattr(b_brush, name))
        if not self.properties.is_property_set("mode"):
            self.mode = b_brush.brush_mode
        super().begin(context, session, event)

    def touch(self, engine_stroke: Any, b_dab: Any, shown: bool) -> None:
        """Harmonics follow at the stroke's end where nobody sees it, or where a dab takes too long with them."""
        begin = time.perf_counter()
        engine_stroke.dab(tuple(b_dab.location), b_dab.radius, shown and bool(self._quick))
        seconds = time.perf_counter() - begin
        if self._quick:
            self._quick = seconds < SLOW
        elif self._quick is None and shown:  # the first dab does without and tells what they would cost
            self._quick = seconds * HARMONICS_COST < SLOW
            if self._quick:
                engine_stroke.show_harmonics()

    def start(self, context: Any, session: EditSession) -> Any:
        from ...engine.edit.brush import Brush
        from ...engine.edit.paint_stroke import PaintStroke, has_paint
        from ...engine.edit.selection import selected_or_refuse

        if "ERASE" in self.mode and not has_paint(session.cloud, opacity="OPACITY" in self.mode):
            raise StippleError(f"{session.name}: there is no paint to erase; {why_no_paint(context)}.")
        brush = Brush(
            mode=self.mode.lower(),
            colour=tuple(self.color),
            opacity=self.opacity,
            strength=self.strength,
            falloff=self.falloff.lower(),
            build_up=self.build_up,
        )
        self._quick = None
        within = selected_or_refuse(session.cloud, "paint") if self.selected_only else None
        return PaintStroke(session.cloud, brush, world_from_object(context), within, self.bl_label)


class STIPPLE_OT_clone(BallStroke, bpy.types.Operator):
    """Copy splats from another place of the capture; Ctrl-click sets the place"""

    bl_idname = "stipple.clone"
    bl_label = "Clone Splats"
    stroke: CollectionProperty(type=StippleDab, options={"HIDDEN", "SKIP_SAVE"})  # type: ignore[valid-type]
    source: FloatVectorProperty(  # type: ignore[valid-type]
        name="Source", description="What is copied to where the stroke begins", subtype="XYZ_LENGTH"
    )

    def begin(self, context: Any, session: EditSession, event: Any) -> None:
        b_settings = context.scene.stipple_edit
        if not self.properties.is_property_set("source"):
            if not b_settings.has_clone_source:
                raise StippleError("Clone Splats: there is no source; Ctrl-click where to copy from.")
            self.source = b_settings.clone_source
        super().begin(context, session, event)

    def start(self, context: Any, session: EditSession) -> Any:
        from ...engine.edit import affine
        from ...engine.edit.duplicate import CloneStroke

        session.check_new_splats(self.bl_label)
        offset = np.array(self.stroke[0].location) - np.array(self.source)
        return CloneStroke(session.cloud, affine.translation(offset), world_from_object(context))

    def sources_of(self, step: Any) -> np.ndarray:
        return step.diffs[-1].which.indices().numpy()


class STIPPLE_OT_clone_source(SplatOperator, bpy.types.Operator):
    """Set the place that Clone copies from"""

    bl_idname = "stipple.clone_source"
    bl_label = "Set Clone Source"
    location: FloatVectorProperty(name="Location", description="Place to copy from, in the world", subtype="XYZ_LENGTH")  # type: ignore[valid-type]

    def invoke(self, context: Any, event: Any) -> set[str]:
        with Reported(self):
            found = pick_under(context, event)
            if found is None:
                raise StippleError("Clone Splats: there is no splat under the cursor.")
            self.location = found.position_world
            return self.execute(context)
        return {"CANCELLED"}

    def execute(self, context: Any) -> set[str]:
        b_settings = context.scene.stipple_edit
        b_settings.clone_source, b_settings.has_clone_source = self.location, True
        return {"FINISHED"}


def why_no_paint(context: Any) -> str:
    """Why an eraser finds nothing where the user may have painted: only edits of linked captures tell paint apart."""
    if is_linked(edited_object(context).data):
        return "every splat is as its file has it"
    return "what was painted before the splats were last read, as on entering Edit Splats, is part of them now"


def pick_under(context: Any, event: Any) -> Any:
    """The splat of the edited capture that is seen under the cursor, by its number there; None where there is none."""
    from ..view_camera import view_of

    check_ready(device_of(context))
    session = session_in(context, by_hand=True)
    picker = Picker.of_session(context, session, view_of(context, context.scene).camera())
    found = picker.pick(event.mouse_region_x, event.mouse_region_y)
    return found and replace(found, splat=session.splat_of(found))


CLASSES = (StippleDab, STIPPLE_OT_paint, STIPPLE_OT_clone, STIPPLE_OT_clone_source)

register, unregister = bpy.utils.register_classes_factory(CLASSES)
