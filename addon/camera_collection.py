# SPDX-License-Identifier: GPL-3.0-or-later
"""Blender cameras made of the views of a camera file, one each or one that is animated."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import bpy
from mathutils import Matrix

from ..engine.formats.camera_images import name_without_suffix
from ..engine.formats.cameras_file import CameraFile
from .camera_animation import animate
from .camera_background import load_background, play_sequence, sequence_start
from .camera_from_view import new_camera_data

MODEL_FOLDER_NAMES = ("sparse", "colmap", "model", "")  # of COLMAP's folders, what says nothing about the capture


@dataclass(frozen=True)
class Views:
    """What is to be made: a camera file, where its cameras stand in the world, and the frame that they will have.

    - `images`: per view; empty where none are wanted.
    - `world_scale`: world units per unit of the capture; `display_size`: of the cameras in the viewport [world units].
    - `aspect`: the scene's pixel_aspect_y / pixel_aspect_x; `frame_shape`: width / height of its frame as displayed.
    """

    file: CameraFile
    matrices: tuple[Matrix, ...]
    images: tuple[Path | None, ...]
    world_scale: float
    aspect: float
    frame_shape: float
    display_size: float


def collection_name(file: CameraFile) -> str:
    """The file's name; for a COLMAP model the name of the folder that says what it is: garden of garden/sparse/0."""
    if file.path != file.folder:
        return file.path.stem
    folder = file.folder.absolute()
    names = (part.name for part in (folder, *folder.parents))
    return next((name for name in names if name not in MODEL_FOLDER_NAMES and not name.isdigit()), "COLMAP")


def _new_camera_object(views: Views, index: int, name: str, made: list[Any]) -> Any:
    b_data = new_camera_data(name, views.file.cameras[index], views.aspect, views.world_scale, views.display_size)
    made.append(b_data)
    b_object = bpy.data.objects.new(name, b_data)
    made.append(b_object)
    return b_object


def still_cameras(views: Views, made: list[Any]) -> list[Any]:
    """One object per view, in no collection yet; every new datablock is appended to `made`, also where it fails."""
    b_objects = []
    for index in range(len(views.file.cameras)):
        b_object = _new_camera_object(views, index, name_without_suffix(views.file.names[index]), made)
        b_object.matrix_world = views.matrices[index]
        if views.images:
            _add_background(views, index, b_object.data, made)
        b_objects.append(b_object)
    return b_objects


def animated_camera(views: Views, made: list[Any], frame_start: int) -> list[Any]:
    """One object with a keyframe per view from `frame_start` on; otherwise as `still_cameras`."""
    b_object = _new_camera_object(views, 0, collection_name(views.file), made)
    try:
        animate(b_object, views.file.cameras, views.matrices, views.aspect, frame_start)
    finally:
        made.extend(b.animation_data.action for b in (b_object, b_object.data) if b.animation_data)
    first_number = sequence_start(views.images) if views.images else None
    if first_number is not None:
        b_background = _add_background(views, 0, b_object.data, made)
        if b_background:
            play_sequence(b_background, first_number, frame_start, len(views.images))
    return [b_object]


def _add_background(views: Views, index: int, b_camera: Any, made: list[Any]) -> Any:
    path = views.images[index]
    b_background = load_background(b_camera, path, views.file.cameras[index], views.frame_shape) if path else None
    if b_background and b_background.image.users == 1:  # no image that was there before
        made.append(b_background.image)
    return b_background
