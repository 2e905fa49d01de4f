# SPDX-License-Identifier: GPL-3.0-or-later
"""Select by where splats are on the screen or in space, and by what they are."""

from __future__ import annotations

from typing import Any, ClassVar

import bpy
import numpy as np
from bpy.props import (
    BoolProperty,
    CollectionProperty,
    EnumProperty,
    FloatProperty,
    FloatVectorProperty,
    IntProperty,
    StringProperty,
)

from ...engine.errors import StippleError
from ...engine.look import Look
from ..crop_places import CropPlaces
from ..edit.circle import CircleStroke
from ..edit.gesture import GestureOperator
from ..edit.operator import ENGINE_MODES, SELECT_MODES, SplatOperator, world_from_object
from ..edit.screen import camera_of, from_top, look_in
from ..edit.session import EditSession
from ..looks import local_box

SIDES = (
    ("FRONT", "Front", "Where the normal points to, and the plane itself"),
    ("BACK", "Back", "The other side, and the plane itself"),
)


class MatchOperator(SplatOperator):
    """Puts what `match` finds into the selection."""

    mode: EnumProperty(  # type: ignore[valid-type]
        name="Mode", description="How what is found is combined with the selection", items=SELECT_MODES, default="SET"
    )

    def step(self, context: Any, session: EditSession) -> Any:
        from ...engine.edit.selection import select

        return select(session.cloud, self.match(context, session), ENGINE_MODES[self.mode])

    def match(self, context: Any, session: EditSession) -> Any:
        raise NotImplementedError


class ScreenOperator(MatchOperator):
    """Finds splats on the screen; pixels count from the bottom left, as Blender's do."""

    camera: StringProperty(  # type: ignore[valid-type]
        name="Camera", description="Camera to look through at the render resolution, in place of the viewport"
    )
    visible_only: BoolProperty(  # type: ignore[valid-type]
        name="Visible Only", description="Leave out what is behind other splats", default=False
    )

    def match(self, context: Any, session: EditSession) -> Any:
        camera = camera_of(context, self.camera)
        found = self.match_on_screen(session, camera, world_from_object(context), look_in(context))
        if self.visible_only:
            from ..edit.visible import visible_mask

            found = found & visible_mask(context, session, camera)
        return found

    def match_on_screen(self, session: EditSession, camera: Any, placed: Any, look: Look) -> Any:
        raise NotImplementedError


class STIPPLE_OT_select_circle(CircleStroke, ScreenOperator, bpy.types.Operator):
    """Select splats with a round brush"""

    bl_idname = "stipple.select_circle"
    bl_label = "Circle Select Splats"
    x: IntProperty(name="X", description="Center of the circle, from the left", subtype="PIXEL")  # type: ignore[valid-type]
    y: IntProperty(name="Y", description="Center of the circle, from the bottom", subtype="PIXEL")  # type: ignore[valid-type]
    radius: IntProperty(name="Radius", description="Radius of the circle", default=50, min=1, subtype="PIXEL")  # type: ignore[valid-type]
    border: BoolProperty(  # type: ignore[valid-type]
        name="Borders", description="Also select splats whose border alone is touched", default=False
    )

    path: CollectionProperty(type=bpy.types.OperatorMousePath, options={"HIDDEN", "SKIP_SAVE"})  # type: ignore[valid-type]

    def step(self, context: Any, session: EditSession) -> Any:
        """One circle at x, y, or the stroke of circles that `path` holds."""
        return self.stroke_step(context, session) if len(self.path) else super().step(context, session)

    def match_on_screen(self, session: EditSession, camera: Any, placed: Any, look: Look) -> Any:
        return self.circle_at(session, camera, placed, look, (self.x, self.y))


class STIPPLE_OT_select_box(GestureOperator, ScreenOperator, bpy.types.Operator):
    """Select splats with a rectangle"""

    bl_idname = "stipple.select_box"
    bl_label = "Box Select Splats"
    xmin: IntProperty(name="X Min", description="Left edge of the rectangle", subtype="PIXEL")  # type: ignore[valid-type]
    xmax: IntProperty(name="X Max", description="Right edge of the rectangle", subtype="PIXEL")  # type: ignore[valid-type]
    ymin: IntProperty(name="Y Min", description="Lower edge of the rectangle", subtype="PIXEL")  # type: ignore[valid-type]
    ymax: IntProperty(name="Y Max", description="Upper edge of the rectangle", subtype="PIXEL")  # type: ignore[valid-type]
    freehand: ClassVar[bool] = False

    def set_path(self, points: list[tuple[float, float]]) -> None:
        (self.xmin, self.ymin), (self.xmax, self.ymax) = np.sort(np.array(points, int), axis=0).tolist()

    def match_on_screen(self, session: EditSession, camera: Any, placed: Any, look: Look) -> Any:
        from ...engine.edit.match_screen import match_rectangle

        low, high = from_top(camera, [(self.xmin, self.ymin), (self.xmax, self.ymax)])
        return match_rectangle(session.cloud, camera, low, high, placed, look)


class STIPPLE_OT_select_lasso(GestureOperator, ScreenOperator, bpy.types.Operator):
    """Select splats inside a line drawn around them"""

    bl_idname = "stipple.select_lasso"
    bl_label = "Lasso Select Splats"
    path: CollectionProperty(type=bpy.types.OperatorMousePath, options={"HIDDEN", "SKIP_SAVE"})  # type: ignore[valid-type]
    freehand: ClassVar[bool] = True

    def set_path(self, points: list[tuple[float, float]]) -> None:
        self.path.clear()
        for point in points:
            self.path.add().loc = point

    def match_on_screen(self, session: EditSession, camera: Any, placed: Any, look: Look) -> Any:
        from ...engine.edit.match_screen import match_polygon

        corners = [tuple(b_point.loc) for b_point in self.path]
        if len(corners) < 3:
            raise StippleError("lasso: draw a line around something.")
        return match_polygon(session.cloud, camera, from_top(camera, corners), placed, look)


class STIPPLE_OT_select_depth(ScreenOperator, bpy.types.Operator):
    """Select splats in a range of distances along the view direction"""

    bl_idname = "stipple.select_depth"
    bl_label = "Select Splats by Depth"
    near: FloatProperty(  # type: ignore[valid-type]
        name="Near", description="Least distance along the view direction", default=0.0, subtype="DISTANCE"
    )
    far: FloatProperty(  # type: ignore[valid-type]
        name="Far", description="Largest distance along the view direction", default=10.0, subtype="DISTANCE"
    )

    def match_on_screen(self, session: EditSession, camera: Any, placed: Any, look: Look) -> Any:
        from ...engine.edit.match_screen import match_depth

        return match_depth(session.cloud, camera, self.near, self.far, placed, look)


class STIPPLE_OT_select_sphere(MatchOperator, bpy.types.Operator):
    """Select splats in a ball"""

    bl_idname = "stipple.select_sphere"
    bl_label = "Select Splats in Sphere"
    center: FloatVectorProperty(name="Center", description="Center of the ball, in the world", subtype="XYZ_LENGTH")  # type: ignore[valid-type]
    radius: FloatProperty(  # type: ignore[valid-type]
        name="Radius", description="Radius of the ball, in the world", default=1.0, min=0.0, subtype="DISTANCE"
    )

    def match(self, context: Any, session: EditSession) -> Any:
        from ...engine.edit.match_space import match_sphere

        return match_sphere(session.cloud, tuple(self.center), self.radius, world_from_object(context))


class STIPPLE_OT_select_plane(MatchOperator, bpy.types.Operator):
    """Select splats on one side of a plane"""

    bl_idname = "stipple.select_plane"
    bl_label = "Select Splats by Plane"
    point: FloatVectorProperty(name="Point", description="A point of the plane, in the world", subtype="XYZ_LENGTH")  # type: ignore[valid-type]
    normal: FloatVectorProperty(  # type: ignore[valid-type]
        name="Normal", description="Direction across the plane, in the world", default=(0, 0, 1), subtype="XYZ"
    )
    side: EnumProperty(  # type: ignore[valid-type]
        name="Side", description="Side of the plane that is selected", items=SIDES, default="FRONT"
    )

    def match(self, context: Any, session: EditSession) -> Any:
        from ...engine.edit.match_space import match_half_space

        normal = np.array(self.normal) * (1 if self.side == "FRONT" else -1)
        return match_half_space(session.cloud, tuple(self.point), normal, world_from_object(context))


class STIPPLE_OT_select_in_object(MatchOperator, bpy.types.Operator):
    """Select splats in the box of an object, as a crop takes it: an empty's as it is drawn, else the bounding box"""

    bl_idname = "stipple.select_in_object"
    bl_label = "Select Splats in Object"
    object: StringProperty(name="Object", description="Object whose box is taken")  # type: ignore[valid-type]

    def match(self, context: Any, session: EditSession) -> Any:
        from ...engine.edit.match_space import match_box

        return match_box(session.cloud, box_of(context, self.object), world_from_object(context))


class STIPPLE_OT_select_opacity(MatchOperator, bpy.types.Operator):
    """Select splats in a range of opacities"""

    bl_idname = "stipple.select_opacity"
    bl_label = "Select Splats by Opacity"
    low: FloatProperty(name="Min", description="Least opacity that is selected", default=0.0, min=0.0, max=1.0)  # type: ignore[valid-type]
    high: FloatProperty(name="Max", description="Largest opacity that is selected", default=0.1, min=0.0, max=1.0)  # type: ignore[valid-type]

    def match(self, context: Any, session: EditSession) -> Any:
        from ...engine.edit.match_values import match_opacity

        return match_opacity(session.cloud, self.low, self.high)


class STIPPLE_OT_select_size(MatchOperator, bpy.types.Operator):
    """Select splats by the longest of their three standard deviations"""

    bl_idname = "stipple.select_size"
    bl_label = "Select Splats by Size"
    low: FloatProperty(name="Min", description="Least size that is selected", default=0.1, min=0.0, subtype="DISTANCE")  # type: ignore[valid-type]
    high: FloatProperty(  # type: ignore[valid-type]
        name="Max", description="Largest size that is selected", default=1e6, min=0.0, subtype="DISTANCE"
    )

    def match(self, context: Any, session: EditSession) -> Any:
        from ...engine.edit.match_values import match_size

        return match_size(session.cloud, self.low, self.high, world_from_object(context))


def box_of(context: Any, name: str) -> Any:
    """The box of an object of the scene as crops have it: from the cube -1 … 1 to the world (3, 4).

    Raises StippleError where there is none, or one that holds nothing.
    """
    b_object = context.scene.objects.get(name)
    if b_object is None:
        raise StippleError(
            f"{name or 'Box'}: this scene has no object of that name; add an empty cube around the splats."
        )
    depsgraph = context.evaluated_depsgraph_get()
    b_object = b_object.evaluated_get(depsgraph)
    matrix = CropPlaces(depsgraph).matrix_of(b_object) @ local_box(b_object)
    if abs(np.linalg.det(matrix[:3, :3])) < 1e-30:
        raise StippleError(f"{name}: its box is flat and holds nothing; give it a thickness along every axis.")
    return matrix[:3]


CLASSES = (
    STIPPLE_OT_select_circle,
    STIPPLE_OT_select_box,
    STIPPLE_OT_select_lasso,
    STIPPLE_OT_select_depth,
    STIPPLE_OT_select_sphere,
    STIPPLE_OT_select_plane,
    STIPPLE_OT_select_in_object,
    STIPPLE_OT_select_opacity,
    STIPPLE_OT_select_size,
)

register, unregister = bpy.utils.register_classes_factory(CLASSES)
