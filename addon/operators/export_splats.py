# SPDX-License-Identifier: GPL-3.0-or-later
"""File > Export > Gaussian Splats: captures as they stand in the world, or as they are, deleted splats left out."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import bpy
import numpy as np
from bpy.props import BoolProperty, EnumProperty, StringProperty
from bpy_extras.io_utils import ExportHelper

from ...engine.edit.state_bits import DELETED, NOT_SELECTABLE, SELECTED
from ...engine.errors import StippleError
from ...engine.splats import ARRAY_NAMES, SplatCloud
from ..edit.mode import Reported
from ..file_names import free_name
from ..linked_capture import is_linked
from ..sequence import plays, splats_at
from ..splat_data import POINT_TYPES, cloud_from_datablock, is_capture, states_of, usable_rows

CONTENTS = (
    ("VISIBLE", "All Captures", "All captures that are visible in the view layer"),
    ("SELECTED", "Selected Objects", "Captures that are selected objects"),
    ("SPLATS", "Selected Splats", "Only selected splats of the selected captures"),
)


class EXPORT_SCENE_OT_splats(bpy.types.Operator, ExportHelper):
    """Export captures as 3DGS PLY files, with every edit in them"""

    bl_idname = "export_scene.splats"
    bl_label = "Export Gaussian Splats"
    bl_options = {"PRESET"}  # noqa: RUF012 - Blender reads a set here

    filename_ext = ".ply"
    filter_glob: StringProperty(default="*.ply", options={"HIDDEN"})  # type: ignore[valid-type]
    content: EnumProperty(name="Include", description="What is written", items=CONTENTS, default="SELECTED")  # type: ignore[valid-type]
    apply_transform: BoolProperty(  # type: ignore[valid-type]
        name="Apply Transform",
        description="Write splats where they are in the world, sizes and view-dependent color with them",
        default=True,
    )
    per_object: BoolProperty(  # type: ignore[valid-type]
        name="File per Object", description="Write one file per object, with its name added", default=False
    )

    def execute(self, context: Any) -> set[str]:
        """Writes nothing unless everything can be written."""
        with Reported(self):
            clouds = [(b_object, self._cloud_of(b_object, context)) for b_object in self._objects(context)]
            found = [(b_object, cloud) for b_object, cloud in clouds if cloud is not None]
            if not found:
                raise StippleError("Export: there is no capture with such splats; select one and try again.")
            count = self._write(found)
            self.report({"INFO"}, f"Exported {count:,} splats of {len(found)} capture(s).")
            return {"FINISHED"}
        return {"CANCELLED"}

    def _objects(self, context: Any) -> list[Any]:
        b_objects = context.view_layer.objects if self.content == "VISIBLE" else context.selected_objects
        return [
            b_object
            for b_object in b_objects
            if b_object.type in POINT_TYPES and is_capture(b_object.data) and b_object.visible_get()
        ]

    def _cloud_of(self, b_object: Any, context: Any) -> SplatCloud | None:
        """What is written of an object; None where that is nothing. Raises StippleError for broken attributes."""
        cloud, dropped = self._at_frame(b_object, context) if plays(b_object) else self._of_data(b_object)
        if dropped:
            self.report({"WARNING"}, f"{b_object.name}: {dropped:,} splats have invalid values and are left out.")
        matrix = np.array(b_object.matrix_world, np.float64)[:3]
        if cloud is None or not self.apply_transform or np.array_equal(matrix, np.eye(3, 4)):
            return cloud
        from ...engine.edit.transform import transform_cloud

        return transform_cloud(cloud, matrix)

    def _at_frame(self, b_object: Any, context: Any) -> tuple[SplatCloud | None, int]:
        """What an object with a sequence shows now, and the splats left out; no splat of a file is selected."""
        if self.content == "SPLATS":
            return None, 0
        b_evaluated = b_object.evaluated_get(context.evaluated_depsgraph_get())  # drivers may say which file it is
        loaded = splats_at(b_evaluated, context.scene.frame_current_final)
        return (None, 0) if loaded is None else (loaded.cloud, loaded.dropped)

    def _of_data(self, b_object: Any) -> tuple[SplatCloud | None, int]:
        """What is written of an object's datablock, and the splats left out."""
        if is_linked(b_object.data):
            raise StippleError(
                f"{b_object.name}: its splats stay in their file; use Linked Capture > Apply to Copy to write them."
            )
        cloud, dropped = cloud_from_datablock(b_object.data, b_object.name)
        states = states_of(b_object.data)
        if cloud is None:
            return None, dropped
        if states is None:
            states = np.zeros(cloud.splat_count, np.uint32)
        elif dropped:
            states = states[usable_rows(b_object.data, b_object.name)]
        kept = (states & DELETED) == 0
        if self.content == "SPLATS":
            kept &= (states & (SELECTED | NOT_SELECTABLE)) == SELECTED  # what hides or locks keeps the selection's bit
        if not kept.any():
            return None, dropped
        if not kept.all():
            cloud = SplatCloud(**{name: getattr(cloud, name)[kept] for name in ARRAY_NAMES}, name=b_object.name)
        return cloud, dropped

    def _write(self, found: list[tuple[Any, SplatCloud]]) -> int:
        from ...engine.formats import write_splats
        from ...engine.formats.atomic_file import replacing_together

        targets = self._targets(Path(bpy.path.abspath(self.filepath)), found)
        with replacing_together() as place:
            for target, cloud in targets:
                write_splats(target, cloud, place)
        return sum(cloud.splat_count for _, cloud in targets)

    def _targets(self, path: Path, found: list[tuple[Any, SplatCloud]]) -> list[tuple[Path, SplatCloud]]:
        """Every file, and what is written to it."""
        from ...engine.edit.duplicate import merge_clouds

        if self.per_object:
            taken: set[str] = set()
            return [
                (path.with_name(free_name(f"{path.stem}_", b_object.name, path.suffix, taken)), cloud)
                for b_object, cloud in found
            ]
        clouds = [cloud for _, cloud in found]
        return [(path, clouds[0] if len(clouds) == 1 else merge_clouds(clouds, path.stem))]


def _draw_menu_entry(self: Any, context: Any) -> None:
    self.layout.operator(EXPORT_SCENE_OT_splats.bl_idname, text="Gaussian Splats (.ply)")


def register() -> None:
    bpy.utils.register_class(EXPORT_SCENE_OT_splats)
    bpy.types.TOPBAR_MT_file_export.append(_draw_menu_entry)


def unregister() -> None:
    bpy.types.TOPBAR_MT_file_export.remove(_draw_menu_entry)
    bpy.utils.unregister_class(EXPORT_SCENE_OT_splats)
