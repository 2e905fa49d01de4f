# SPDX-License-Identifier: GPL-3.0-or-later
"""File > Import > Cameras for Gaussian Splats: the views of a camera file as Blender cameras, or as an animated one."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import bpy
import numpy as np
import numpy.typing as npt
from bpy.props import BoolProperty, EnumProperty, StringProperty
from bpy_extras.io_utils import ImportHelper
from mathutils import Euler

from ...engine.camera import Camera
from ...engine.errors import StippleError
from ...engine.formats.camera_images import find_images
from ...engine.formats.cameras_file import read_camera_file
from ..camera_background import sequence_start
from ..camera_collection import Views, animated_camera, collection_name, still_cameras
from ..camera_from_view import (
    ASPECT_TOLERANCE,
    display_size_of,
    is_similarity,
    scale_of,
    scene_aspect,
    set_frame,
    view_aspect,
    world_from_blender_camera,
)
from ..splat_data import is_capture_object
from .import_splats import PATH_OPTIONS, ROTATION_OF_UP_AXIS, UP_AXES

log = logging.getLogger(__package__)


class IMPORT_SCENE_OT_splat_cameras(bpy.types.Operator, ImportHelper):
    """Import the cameras of a Gaussian splat capture from a COLMAP model, cameras.json or transforms.json"""

    bl_idname = "import_scene.splat_cameras"
    bl_label = "Import Cameras for Gaussian Splats"
    bl_options = {"REGISTER", "UNDO", "PRESET"}  # noqa: RUF012 - Blender reads a set here

    filter_glob: StringProperty(default="*.json;*.bin;*.txt", options={"HIDDEN"})  # type: ignore[valid-type]
    filepath: StringProperty(subtype="FILE_PATH", options=PATH_OPTIONS)  # type: ignore[valid-type]
    directory: StringProperty(subtype="DIR_PATH", options=PATH_OPTIONS)  # type: ignore[valid-type]
    as_animation: BoolProperty(  # type: ignore[valid-type]
        name="As Animation",
        description="Make one camera with a keyframe per view, and set the frame range and resolution for it",
        default=False,
    )
    match_active: BoolProperty(  # type: ignore[valid-type]
        name="Match Capture",
        description="Place the cameras around the active or selected capture, as it is placed in the scene",
        default=True,
    )
    up_axis: EnumProperty(  # type: ignore[valid-type]
        name="Up Axis",
        description="Direction of the file that becomes up, where the cameras match no capture",
        items=UP_AXES,
        default="NEGATIVE_Y",
    )
    background_images: BoolProperty(  # type: ignore[valid-type]
        name="Background Images",
        description="Show the photographs behind the cameras, where they are found next to the file",
        default=True,
    )
    set_resolution: BoolProperty(  # type: ignore[valid-type]
        name="Set Resolution",
        description="Set the scene's resolution to the first view's size; an animated camera always does",
        default=False,
    )

    def draw(self, context: Any) -> None:
        self.layout.use_property_split = True
        self.layout.use_property_decorate = False
        column = self.layout.column()
        column.prop(self, "match_active")
        row = column.row()
        row.active = not (self.match_active and capture_to_match(context))
        row.prop(self, "up_axis")
        column.prop(self, "background_images")
        column.prop(self, "as_animation")
        row = column.row()
        row.active = not self.as_animation
        row.prop(self, "set_resolution")

    def execute(self, context: Any) -> set[str]:
        """All cameras or none."""
        path = Path(bpy.path.abspath(self.filepath or self.directory))
        try:
            self._import(context, path)
        except StippleError as error:
            self.report({"ERROR"}, str(error))
        except Exception as error:
            log.exception("Unexpected error while importing %s", path)
            self.report({"ERROR"}, f"{path.name}: import failed: {type(error).__name__}: {error} (see the console).")
        else:
            return {"FINISHED"}
        return {"CANCELLED"}

    def _import(self, context: Any, path: Path) -> None:
        views = self._views(context, path)
        b_scene = context.scene
        made: list[Any] = []  # datablocks, newest last
        try:
            b_collection = bpy.data.collections.new(collection_name(views.file))
            made.append(b_collection)
            b_objects = (
                animated_camera(views, made, b_scene.frame_start) if self.as_animation else still_cameras(views, made)
            )
            for b_object in b_objects:
                b_collection.objects.link(b_object)
            _link(context, b_collection)
        except BaseException:
            bpy.data.batch_remove(made)
            raise
        b_scene.camera = b_objects[0]
        self._set_scene(b_scene, views)
        for warning in (*views.file.warnings, *self._warnings(b_scene, views)):
            self.report({"WARNING"}, warning)
        self.report({"INFO"}, self._summary(views))

    def _views(self, context: Any, path: Path) -> Views:
        """Everything that can fail for a file's sake; changes nothing."""
        file = read_camera_file(path)
        world_from_capture = self._world_from_capture(context)
        scale = scale_of(world_from_capture)
        if not (np.isfinite(scale) and scale > 0):
            raise StippleError(f"{path.name}: the active capture's scale is zero along an axis; give it a scale.")
        if not is_similarity(world_from_capture):
            self.report(
                {"WARNING"},
                "The active capture is scaled unevenly, sheared or mirrored, which cameras cannot follow: "
                "their pictures differ from the file's.",
            )
        aspect, frame_shape = self._frame(context.scene.render, file.cameras)
        matrices = tuple(world_from_blender_camera(world_from_capture, camera) for camera in file.cameras)
        return Views(
            file=file,
            matrices=matrices,
            images=find_images(file) if self.background_images else (),
            world_scale=scale,
            aspect=aspect,
            frame_shape=frame_shape,
            display_size=display_size_of(matrices),
        )

    def _frame(self, b_render: Any, cameras: Sequence[Camera]) -> tuple[float, float]:
        """Pixel aspect and shape of the frame, as they will be after the import."""
        if not self._sets_frame:
            aspect = scene_aspect(b_render)
            return aspect, b_render.resolution_x / (b_render.resolution_y * aspect)
        aspects = [view_aspect(camera) for camera in cameras]
        agree = max(aspects) <= min(aspects) * (1 + ASPECT_TOLERANCE)
        aspect = aspects[0] if agree else scene_aspect(b_render)
        return aspect, cameras[0].width / (cameras[0].height * aspect)

    @property
    def _sets_frame(self) -> bool:
        return bool(self.as_animation or self.set_resolution)

    def _world_from_capture(self, context: Any) -> npt.NDArray[np.float64]:
        b_capture = capture_to_match(context) if self.match_active else None
        if b_capture is None:
            return np.array(Euler(ROTATION_OF_UP_AXIS[self.up_axis]).to_matrix().to_4x4(), dtype=np.float64)
        context.view_layer.update()  # a script may have moved it a line ago
        return np.array(b_capture.matrix_world, dtype=np.float64)

    def _set_scene(self, b_scene: Any, views: Views) -> None:
        if self._sets_frame:
            set_frame(b_scene.render, views.file.cameras[0], views.aspect)
        if self.as_animation:
            b_scene.frame_end = b_scene.frame_start + len(views.file.cameras) - 1

    def _warnings(self, b_scene: Any, views: Views) -> list[str]:
        cameras, name, warnings = views.file.cameras, views.file.path.name, []
        aspect = scene_aspect(b_scene.render)
        if any(abs(view_aspect(camera) / aspect - 1) > ASPECT_TOLERANCE for camera in cameras):
            warnings.append(
                f"{name}: fx / fy is not the scene's pixel aspect, which Blender has one of for all cameras and which "
                f"was left alone; for the first view, Output properties > Format > Aspect Y / X would have to be "
                f"{view_aspect(cameras[0]):.6g}."
            )
        sizes = {(camera.width, camera.height) for camera in cameras}
        if self._sets_frame and len(sizes) > 1:
            warnings.append(
                f"{name}: the views have {len(sizes)} sizes; the scene has the first view's, "
                f"and the others keep their width of view in it."
            )
        return warnings

    def _summary(self, views: Views) -> str:
        count, missing = len(views.file.cameras), views.images.count(None)
        made = f"one camera with {count} keyframes" if self.as_animation else f"{count} cameras"
        text = f"{views.file.path.name}: imported {made}."
        if missing:
            text += f" Background images: {count - missing} found, {missing} missing."
        if self.as_animation and views.images and missing < count and sequence_start(views.images) is None:
            text += " They are not shown, for they are no sequence of consecutive numbers."
        return text


def capture_to_match(context: Any) -> Any:
    """The active object where it is a capture, else the first selected capture; None without one."""
    b_candidates = [context.view_layer.objects.active, *context.view_layer.objects.selected]
    return next(filter(is_capture_object, b_candidates), None)


def _link(context: Any, b_collection: Any) -> None:
    try:
        context.view_layer.active_layer_collection.collection.children.link(b_collection)
    except RuntimeError:
        raise StippleError("The active collection is linked from another file; choose one of this file.") from None


def _draw_menu_entry(self: Any, context: Any) -> None:
    self.layout.operator(IMPORT_SCENE_OT_splat_cameras.bl_idname, text="Cameras for Gaussian Splats (.json, COLMAP)")


def register() -> None:
    bpy.utils.register_class(IMPORT_SCENE_OT_splat_cameras)
    bpy.types.TOPBAR_MT_file_import.append(_draw_menu_entry)


def unregister() -> None:
    bpy.types.TOPBAR_MT_file_import.remove(_draw_menu_entry)
    bpy.utils.unregister_class(IMPORT_SCENE_OT_splat_cameras)
