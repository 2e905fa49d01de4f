# SPDX-License-Identifier: GPL-3.0-or-later
"""Splats to objects of their own and back: separate, join, align by three pairs of points."""

from __future__ import annotations

from typing import Any

import bpy
import numpy as np
from bpy.props import BoolProperty, FloatVectorProperty
from mathutils import Matrix

from ...engine.edit.state_bits import DELETED
from ...engine.errors import StippleError
from ...engine.splats import ARRAY_NAMES, SplatCloud
from .. import sync
from ..edit.mode import OnActiveCapture, Reported, edited_object
from ..edit.operator import SplatOperator, busy, redraw, session_in
from ..edit.pairs import PairsOperator
from ..edit.session import check_editable, session_of
from ..linked_capture import is_linked
from ..own_attributes import joined_columns, own_columns, put_columns
from ..placing import LetGo, stand_at
from ..point_rows import Columns, check_points_only
from ..sequence import plays
from ..splat_data import cloud_from_datablock, datablock_from_cloud, is_capture_object, states_of


class STIPPLE_OT_separate(SplatOperator, bpy.types.Operator):
    """Put the selected splats in an object of their own, in the same place"""

    bl_idname = "stipple.separate"
    bl_label = "Separate Splats"

    def execute(self, context: Any) -> set[str]:
        with Reported(self):
            b_object, session = edited_object(context), session_in(context, self.by_hand)
            with busy(context) as progress:
                cloud, step = session.separate(b_object.name, progress)
            columns = {}  # a linked capture's points are not its splats
            if not is_linked(b_object.data):
                rows = session.cloud.selection().indices().numpy()
                columns = own_columns(b_object.data, rows, b_object.name)
            b_data = datablock_from_cloud(cloud, b_object.name)
            try:
                put_columns(b_data, columns)
                for b_material in b_object.data.materials:
                    b_data.materials.append(b_material)
                session.commit(b_object.data, step)
            except BaseException:
                bpy.data.batch_remove([b_data])
                raise
            b_new = b_object.copy()
            b_new.data, b_new.stipple_editing = b_data, False
            for b_collection in b_object.users_collection:
                b_collection.objects.link(b_new)
            b_new.select_set(True)
            self.report({"INFO"}, f"{b_new.name}: {cloud.splat_count:,} splats.")
            redraw(context)
            return {"FINISHED"}
        return {"CANCELLED"}


class STIPPLE_OT_join(bpy.types.Operator):
    """Join the selected captures into the active one; they may have different SH degrees"""

    bl_idname = "stipple.join"
    bl_label = "Join Captures"
    bl_options = {"REGISTER", "UNDO"}  # noqa: RUF012 - Blender reads a set here

    @classmethod
    def poll(cls, context: Any) -> bool:
        b_active = getattr(context, "object", None)
        b_selected = getattr(context, "selected_objects", [])
        if context.mode != "OBJECT" or b_active is None or b_active not in b_selected or len(b_selected) < 2:
            cls.poll_message_set("Select two or more captures, the one to join into last")
            return False
        return is_capture_object(b_active)

    def execute(self, context: Any) -> set[str]:
        """All or none: what is joined is removed only once the active capture holds it."""
        from ...engine.edit.duplicate import append_cloud, merge_clouds

        with Reported(self):
            b_active = context.object
            b_others = [b_object for b_object in context.selected_objects if b_object is not b_active]
            self._check(b_active, b_others)
            parts = [_kept_in(b_other, b_active.matrix_world) for b_other in b_others]
            joined = merge_clouds([cloud for cloud, _ in parts])
            added = joined_columns(b_active.data, b_active.name, parts)
            with busy(context) as progress:
                session = session_of(b_active, sync.DEVICE[context.scene.stipple.device], progress)
            sources = np.full(joined.splat_count, -1)
            b_children = [b_child for b_other in b_others for b_child in b_other.children if b_child not in b_others]
            with LetGo(b_children, context):  # or they would move when their parents are gone, the active one too
                session.commit(b_active.data, append_cloud(session.cloud, joined), sources, added=added)
            for b_other in b_others:
                b_data = b_other.data
                bpy.data.objects.remove(b_other)
                if not b_data.users:
                    bpy.data.batch_remove([b_data])
            redraw(context)
            return {"FINISHED"}
        return {"CANCELLED"}

    @staticmethod
    def _check(b_active: Any, b_others: list[Any]) -> None:
        for b_object in [b_active, *b_others]:
            if not is_capture_object(b_object):
                raise StippleError(f"{b_object.name}: this is no capture; select captures only to join them.")
            if plays(b_object):
                raise StippleError(f"{b_object.name}: it plays a sequence of files; turn the sequence off to join it.")
            if is_linked(b_object.data):
                raise StippleError(f"{b_object.name}: its splats stay in their file; import the file to join it.")
        check_editable(b_active)
        check_points_only(b_active.data, b_active.name)
        for b_other in b_others:
            if b_other.library is not None:
                raise StippleError(f"{b_other.name}: it is linked from another file; make it local first.")
        if abs(b_active.matrix_world.determinant()) < 1e-30:
            raise StippleError(f"{b_active.name}: its scale is zero; give every axis a scale to join into it.")


def _kept_in(b_object: Any, b_matrix_world: Matrix) -> tuple[SplatCloud, Columns]:
    """An object's splats that are not deleted, in the space of an object with the given matrix, and what they carry."""
    from ...engine.edit.transform import transform_cloud

    cloud, dropped = cloud_from_datablock(b_object.data, b_object.name)
    if cloud is None or dropped:
        raise StippleError(f"{b_object.name}: {dropped:,} splats have invalid values; use Delete Invalid first.")
    states = states_of(b_object.data)
    kept = np.ones(cloud.splat_count, bool) if states is None else (states & DELETED) == 0
    if not kept.any():
        raise StippleError(f"{b_object.name}: every splat is deleted; restore some, or do not select it.")
    if not kept.all():
        cloud = SplatCloud(**{name: getattr(cloud, name)[kept] for name in ARRAY_NAMES}, name=b_object.name)
    columns = own_columns(b_object.data, np.flatnonzero(kept), b_object.name)
    if b_object.matrix_world == b_matrix_world:
        return cloud, columns
    to_world, to_other = np.array(b_object.matrix_world, np.float64), np.array(b_matrix_world, np.float64)
    return transform_cloud(cloud, np.linalg.solve(to_other, to_world)[:3]), columns


class STIPPLE_OT_align_points(OnActiveCapture, PairsOperator, bpy.types.Operator):
    """Bring three points of the active capture to three other points, by moving and turning the object"""

    bl_idname = "stipple.align_points"
    bl_label = "Align by Three Points"
    source_1: FloatVectorProperty(  # type: ignore[valid-type]
        name="Source 1", description="Place on the active capture, in the world", subtype="XYZ_LENGTH"
    )
    source_2: FloatVectorProperty(  # type: ignore[valid-type]
        name="Source 2", description="Place on the active capture, in the world", subtype="XYZ_LENGTH"
    )
    source_3: FloatVectorProperty(  # type: ignore[valid-type]
        name="Source 3", description="Place on the active capture, in the world", subtype="XYZ_LENGTH"
    )
    target_1: FloatVectorProperty(  # type: ignore[valid-type]
        name="Target 1", description="Place that it is brought to, in the world", subtype="XYZ_LENGTH"
    )
    target_2: FloatVectorProperty(  # type: ignore[valid-type]
        name="Target 2", description="Place that it is brought to, in the world", subtype="XYZ_LENGTH"
    )
    target_3: FloatVectorProperty(  # type: ignore[valid-type]
        name="Target 3", description="Place that it is brought to, in the world", subtype="XYZ_LENGTH"
    )
    use_scale: BoolProperty(name="Scale", description="Also scale the object", default=True)  # type: ignore[valid-type]

    def execute(self, context: Any) -> set[str]:
        from ...engine.edit.align import align_points

        source, target = (
            [tuple(getattr(self, f"{side}_{number}")) for number in (1, 2, 3)] for side in ("source", "target")
        )
        with Reported(self):
            matrix = align_points(source, target, self.use_scale)
            b_matrix = Matrix([*matrix.tolist(), [0, 0, 0, 1]]) @ context.object.matrix_world
            stand_at(context.object, b_matrix, "where the points are to be", context)
            return {"FINISHED"}
        return {"CANCELLED"}


CLASSES = (STIPPLE_OT_separate, STIPPLE_OT_join, STIPPLE_OT_align_points)

register, unregister = bpy.utils.register_classes_factory(CLASSES)
