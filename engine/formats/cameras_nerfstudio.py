# SPDX-License-Identifier: GPL-3.0-or-later
"""nerfstudio's `transforms.json`, also written by Instant-NGP, Polycam, Record3D and NeRF's synthetic scenes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from .camera_images import Listings, find_image
from .cameras_entry import Entry, Fields, camera_from_world_of, entry_mapping
from .image_size import size_of_image

GSPLAT_NEAR = 0.01  # gsplat's near_plane, which nerfstudio's splatfacto leaves at its default [world units]
PINHOLE_MODELS = ("OPENCV", "PINHOLE", "SIMPLE_PINHOLE", "SIMPLE_RADIAL", "RADIAL", "PERSPECTIVE")
DISTORTION_KEYS = ("k1", "k2", "k3", "k4", "k5", "k6", "p1", "p2")
CV_FROM_GL = np.array([1.0, -1.0, -1.0])  # OpenGL: y up, z backward; here: y down, z forward


def parse(document: dict[str, Any], path: Path) -> list[Entry]:
    """Cameras of `frames`, in the file's order (nerfstudio itself sorts them by name before it splits them).

    - `w`, `h`, `fl_x`, `fl_y`, `cx`, `cy` [px] or `camera_angle_x`, `camera_angle_y` [rad], in the frame or for all
      frames. `fl_y` defaults to `fl_x`, the principal point to the centre. Where `w` and `h` are both missing, as in
      NeRF's synthetic scenes, the size is that of the frame's image.
    - `transform_matrix` (4×4 or 3×4) is world-from-camera with OpenGL's axes (x right, y up, z backward): its second
      and third columns change sign here.
    - `applied_transform` is the map nerfstudio had already multiplied onto the poses when it wrote the file. It is
      neither applied again nor undone: cameras come out in the world of the file, which is the world of a capture
      trained from this file. nerfstudio's own trainer moves and scales that world once more (its
      `dataparser_transforms.json`); captures it exports need that map too, which is not done here.
    - Distortion (`k1` … `p2`) is left out with a warning. A fisheye or panoramic `camera_model` is refused, for no
      pinhole picture resembles it.

    Raises StippleError naming the file, the camera and the key.
    """
    folders: Listings = {}
    return [
        _parse_one(Fields(path, index, entry_mapping(path, index, item), document), folders)
        for index, item in enumerate(document["frames"])
    ]


def _parse_one(fields: Fields, folders: Listings) -> Entry:
    model = fields.value("camera_model") if fields.has("camera_model") else "PINHOLE"
    if model not in PINHOLE_MODELS:
        raise fields.fail("camera_model", f"is {model!r}; undistort the images to a pinhole model first")
    width, height = _size(fields, folders)
    fx, fy = _focal_lengths(fields, width, height)
    camera = fields.camera(
        _camera_from_world(fields),
        width=width,
        height=height,
        fx=fx,
        fy=fy,
        cx=fields.number("cx", width / 2),
        cy=fields.number("cy", height / 2),
        near=GSPLAT_NEAR,
    )
    name = fields.value("file_path") if fields.has("file_path") else fields.index
    return Entry(camera, str(name), _distortion_warnings(fields))


def _size(fields: Fields, folders: Listings) -> tuple[int, int]:
    """(width, height) [px] as the file says or as the image has them."""
    if fields.has("w") or fields.has("h") or not fields.has("file_path"):
        return fields.size("w"), fields.size("h")
    image = find_image(fields.path.parent, str(fields.value("file_path")), folders)
    if image is None:
        raise fields.fail("w", "and h are missing, and so is the image that would tell them; add them to the file")
    return size_of_image(image)


def _focal_lengths(fields: Fields, width: int, height: int) -> tuple[float, float]:
    """(fx, fy) [px] from focal lengths or fields of view."""
    if fields.has("fl_x"):
        fx = fields.positive("fl_x")
    elif fields.has("camera_angle_x"):
        fx = width / 2 / np.tan(_angle(fields, "camera_angle_x") / 2)
    else:
        raise fields.fail("fl_x", "and camera_angle_x are both missing; add one of them to the file")
    if not fields.has("fl_y") and fields.has("camera_angle_y"):
        return fx, height / 2 / np.tan(_angle(fields, "camera_angle_y") / 2)
    return fx, fields.positive("fl_y", fx)


def _angle(fields: Fields, key: str) -> float:
    angle = fields.positive(key)
    if angle >= np.pi:
        raise fields.fail(key, f"is {angle:g} rad; give a field of view below pi")
    return angle


def _camera_from_world(fields: Fields) -> npt.NDArray[np.float64]:
    world_from_gl = fields.matrix("transform_matrix", (4, 4), (3, 4))
    rotation = world_from_gl[:3, :3] * CV_FROM_GL
    fields.check_rotation("transform_matrix", rotation)
    return camera_from_world_of(rotation, world_from_gl[:3, 3])


def _distortion_warnings(fields: Fields) -> tuple[str, ...]:
    present = [key for key in DISTORTION_KEYS if fields.number(key, 0.0) != 0.0]
    if not present:
        return ()
    return (
        f"{fields.path}: lens distortion ({', '.join(present)}) is ignored; "
        f"the picture is that of an ideal pinhole camera.",
    )
