# SPDX-License-Identifier: GPL-3.0-or-later
"""COLMAP models written for tests, the Blender cameras that are made of them, and how far the two are apart."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest

from stipple.addon.camera import camera_from_blender
from stipple.engine.camera import Camera, look_at
from tests.colmap_files import Lens, view_of, write_binary

PINHOLE = Lens(1, "PINHOLE", 640, 480, (520.0, 520.0, 341.5, 222.25))
POINTS = np.random.default_rng(5).uniform(-1, 1, (60, 3))


def cameras_around(lens: Lens = PINHOLE, count: int = 12) -> list[Camera]:
    """Twice around the origin, from above and below."""
    fx, fy, cx, cy = lens.parameters
    cameras = []
    for angle in np.linspace(0, 4 * np.pi, count, endpoint=False):
        eye = (5 * np.cos(angle), 2 * np.sin(2.3 * angle), 5 * np.sin(angle))
        cameras.append(Camera(look_at(eye, (0.1, 0.2, 0.3)), lens.width, lens.height, fx, fy, cx, cy))
    return cameras


def write_model(folder: Path, lens: Lens = PINHOLE, count: int = 12, name: str = "frame_{:04d}.png") -> Path:
    cameras = cameras_around(lens, count)
    views = [view_of(index, camera, name.format(index + 7)) for index, camera in enumerate(cameras)]
    return write_binary(folder, [lens], views)


def import_cameras(path: Path, **options: Any) -> list[Any]:
    assert bpy.ops.import_scene.splat_cameras(filepath=str(path), **options) == {"FINISHED"}
    bpy.context.view_layer.update()
    b_collection = next(b for b in bpy.data.collections if b.name in bpy.context.scene.collection.children)
    return list(b_collection.objects)


def set_size(width: int = 640, height: int = 480) -> None:
    b_render = bpy.context.scene.render
    b_render.resolution_x, b_render.resolution_y, b_render.resolution_percentage = width, height, 100


def error_px(b_camera: Any, camera: Camera, world_from_capture: np.ndarray) -> float:
    """How far apart the Blender camera and the file's see the same points [px]."""
    seen = camera_from_blender(b_camera, bpy.context.scene.render)
    assert (seen.width, seen.height) == (camera.width, camera.height)
    points_world = POINTS @ world_from_capture[:3, :3].T + world_from_capture[:3, 3]
    return float(np.abs(seen.project(points_world) - camera.project(POINTS))[:, :2].max())


def datablocks() -> dict[str, int]:
    names = ("objects", "cameras", "collections", "actions", "images")
    return {name: len(getattr(bpy.data, name)) for name in names}


def messages(capfd: pytest.CaptureFixture[str], kind: str) -> list[str]:
    printed = capfd.readouterr()
    return [line for line in (printed.out + printed.err).splitlines() if line.startswith(f"{kind}: ")]
