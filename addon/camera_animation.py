# SPDX-License-Identifier: GPL-3.0-or-later
"""Views as the animation of one camera: a keyframe per frame on place, rotation, lens and shifts."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from mathutils import Matrix

from ..engine.camera import Camera
from .animated_paths import curves_of
from .camera_from_view import set_lens

OBJECT_PATHS = ("location", "rotation_quaternion")
DATA_PATHS = ("lens", "shift_x", "shift_y")


def animate(b_object: Any, cameras: Sequence[Camera], matrices: Sequence[Matrix], aspect: float, start: int) -> None:
    """Keys view i at frame `start` + i, with straight lines between the keys.

    Quaternions keep to one hemisphere from key to key: the camera never takes the long way around.
    """
    b_object.rotation_mode = "QUATERNION"
    previous = None
    for frame, (camera, matrix) in enumerate(zip(cameras, matrices, strict=True), start=start):
        quaternion = matrix.to_quaternion()
        if previous is not None and previous.dot(quaternion) < 0:
            quaternion.negate()
        previous = quaternion
        b_object.location, b_object.rotation_quaternion = matrix.translation, quaternion
        set_lens(b_object.data, camera, aspect)
        for b_owner, paths in ((b_object, OBJECT_PATHS), (b_object.data, DATA_PATHS)):
            for path in paths:
                b_owner.keyframe_insert(path, frame=frame)
    for b_owner in (b_object, b_object.data):
        for b_curve in curves_of(b_owner):
            for b_key in b_curve.keyframe_points:
                b_key.interpolation = "LINEAR"
