# SPDX-License-Identifier: GPL-3.0-or-later
"""File > Import > Gaussian Splats, also by dropping files on the 3D viewport."""

from __future__ import annotations

import logging
import math
from pathlib import Path
from typing import Any

import bpy
from bpy.props import BoolProperty, CollectionProperty, EnumProperty, StringProperty
from bpy_extras.io_utils import ImportHelper

from ...engine.errors import Cancelled, StippleError
from ..preferences import link_above
from ..splat_data import SOURCE_PROPERTY, datablock_from_cloud
from .link_captures import linked_data_from_file, shown_progress

HALF_TURN = math.pi
QUARTER_TURN = math.pi / 2

# Rotation (Euler XYZ [rad]) that turns the file's up direction to Blender's +Z.
ROTATION_OF_UP_AXIS = {
    "X": (0.0, -QUARTER_TURN, 0.0),
    "Y": (QUARTER_TURN, 0.0, 0.0),
    "Z": (0.0, 0.0, 0.0),
    "NEGATIVE_X": (0.0, QUARTER_TURN, 0.0),
    "NEGATIVE_Y": (-QUARTER_TURN, 0.0, 0.0),
    "NEGATIVE_Z": (HALF_TURN, 0.0, 0.0),
}
UP_AXES = (
    ("X", "X", "The file's X axis points up"),
    ("Y", "Y", "The file's Y axis points up"),
    ("Z", "Z", "The file's Z axis points up, as in Blender"),
    ("NEGATIVE_X", "-X", "The file's X axis points down"),
    ("NEGATIVE_Y", "-Y", "The file's Y axis points down, as in most captures (COLMAP)"),
    ("NEGATIVE_Z", "-Z", "The file's Z axis points down"),
)
PATH_OPTIONS = {"SKIP_SAVE", "HIDDEN", "PATH_SUPPORTS_BLEND_RELATIVE"}
log = logging.getLogger(__package__)


class IMPORT_SCENE_OT_splats(bpy.types.Operator, ImportHelper):
    """Import Gaussian splat captures"""

    bl_idname = "import_scene.splats"
    bl_label = "Import Gaussian Splats"
    bl_options = {"REGISTER", "UNDO", "PRESET"}  # noqa: RUF012 - Blender reads a set here

    filename_ext = ".ply"
    filter_glob: StringProperty(default="*.ply", options={"HIDDEN"})  # type: ignore[valid-type]
    filepath: StringProperty(subtype="FILE_PATH", options=PATH_OPTIONS)  # type: ignore[valid-type]
    directory: StringProperty(subtype="DIR_PATH", options=PATH_OPTIONS)  # type: ignore[valid-type]
    files: CollectionProperty(  # type: ignore[valid-type]
        type=bpy.types.OperatorFileListElement, options={"SKIP_SAVE", "HIDDEN"}
    )
    up_axis: EnumProperty(  # type: ignore[valid-type]
        name="Up Axis",
        description="Direction of the file that becomes up; only the object is turned, never the splats",
        items=UP_AXES,
        default="NEGATIVE_Y",
    )
    link: BoolProperty(  # type: ignore[valid-type]
        name="Link",
        description="Leave the splats in the file and keep only its path and a few points here. "
        "Captures above the limit in the preferences are always linked",
        default=False,
    )

    def invoke(self, context: Any, event: Any) -> set[str]:
        return self.invoke_popup(context)

    def draw(self, context: Any) -> None:
        self.layout.use_property_split = True
        self.layout.use_property_decorate = False
        self.layout.prop(self, "up_axis")
        self.layout.prop(self, "link")

    def execute(self, context: Any) -> set[str]:
        """One object per file, each whole or not at all; a file that cannot be read does not stop the others."""
        if context.mode != "OBJECT" and context.object:
            bpy.ops.object.mode_set(mode="OBJECT")  # the new object becomes active; what was edited must not be stuck
        b_objects = [b_object for path in self._paths() if (b_object := self._import(context, path))]
        if not b_objects:
            return {"CANCELLED"}
        select_only(context, b_objects)
        return {"FINISHED"}

    def _paths(self) -> list[Path]:
        if self.files and self.directory:
            return [Path(bpy.path.abspath(self.directory)) / b_file.name for b_file in self.files]
        return [Path(bpy.path.abspath(self.filepath))]

    def _import(self, context: Any, path: Path) -> Any:
        try:
            return self._object_from_file(context, path)
        except StippleError as error:
            self.report({"ERROR"}, str(error))
        except (Cancelled, KeyboardInterrupt):
            self.report({"WARNING"}, f"{path.name}: cancelled; it is not imported.")
        except MemoryError:
            self.report({"ERROR"}, f"{path.name}: there is not enough memory to import it.")
        except Exception as error:
            log.exception("Unexpected error while importing %s", path)
            self.report({"ERROR"}, f"{path.name}: import failed: {type(error).__name__}: {error} (see the console).")
        return None

    def _object_from_file(self, context: Any, path: Path) -> Any:
        from ...engine.formats import open_splats

        source = open_splats(path)
        linked = self.link or source.splat_count > link_above()
        if linked:
            b_data, warnings = linked_data_from_file(context, path)
            count = b_data.stipple_capture.splat_count
        else:
            with shown_progress(context) as progress:
                loaded = source.read(progress)
            b_data, warnings, count = datablock_from_cloud(loaded.cloud, path.stem), loaded.warnings, source.splat_count
            count -= loaded.dropped
            b_data[SOURCE_PROPERTY] = str(path)
        b_object = bpy.data.objects.new(path.stem, b_data)
        b_object.rotation_euler = ROTATION_OF_UP_AXIS[self.up_axis]
        try:
            context.view_layer.active_layer_collection.collection.objects.link(b_object)
        except RuntimeError:
            bpy.data.batch_remove([b_object, b_data])
            raise StippleError("The active collection is linked from another file; choose one of this file.") from None
        for warning in warnings:  # among them the splats left out, counted
            self.report({"WARNING"}, warning)
        self.report({"INFO"}, f"{path.name}: {'linked' if linked else 'imported'} {count:,} splats.")
        return b_object


class IO_FH_stipple_splats(bpy.types.FileHandler):
    """Splat files dropped on the 3D viewport; Blender asks which importer to use where several take the file."""

    bl_idname = "IO_FH_stipple_splats"
    bl_label = "Gaussian Splats"
    bl_import_operator = "import_scene.splats"
    bl_file_extensions = ".ply"

    @classmethod
    def poll_drop(cls, context: Any) -> bool:
        return bool(context.area and context.area.type in {"VIEW_3D", "OUTLINER"})


def select_only(context: Any, b_objects: list[Any]) -> None:
    """Selects these objects and nothing else; the last becomes active."""
    for b_object in context.view_layer.objects.selected:
        b_object.select_set(False)
    for b_object in b_objects:
        b_object.select_set(True)
    context.view_layer.objects.active = b_objects[-1]


def _draw_menu_entry(self: Any, context: Any) -> None:
    self.layout.operator(IMPORT_SCENE_OT_splats.bl_idname, text="Gaussian Splats (.ply)")


CLASSES = (IMPORT_SCENE_OT_splats, IO_FH_stipple_splats)


def register() -> None:
    for cls in CLASSES:
        bpy.utils.register_class(cls)
    bpy.types.TOPBAR_MT_file_import.append(_draw_menu_entry)


def unregister() -> None:
    bpy.types.TOPBAR_MT_file_import.remove(_draw_menu_entry)
    for cls in reversed(CLASSES):
        bpy.utils.unregister_class(cls)
