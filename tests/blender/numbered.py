# SPDX-License-Identifier: GPL-3.0-or-later
"""A folder of numbered captures, each of another size, and what an object that plays it shows."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import bpy

from stipple.addon import sync
from stipple.addon.residency import CloudCache
from stipple.engine.scene import Scene

from .captures import random_cloud, write_ply

COUNTS = {1: 30, 2: 50, 3: 40, 5: 20}  # splats by number; 4 is missing


def write_numbered(folder: Path) -> Path:
    """`walk/walk.0001.ply` and so on in the folder; returns `walk`."""
    files = folder / "walk"
    files.mkdir()
    for number, count in COUNTS.items():
        write_ply(files / f"walk.{number:04d}.ply", random_cloud(count, 1, seed=number, size=0.15))
    return files


def import_sequence(folder: Path, number: int = 1) -> Any:
    bpy.ops.import_scene.splats(filepath=str(folder / f"walk.{number:04d}.ply"), sequence=True)
    b_object = bpy.context.view_layer.objects.active
    b_object.rotation_euler = (0, 0, 0)
    return b_object


def shown(frame: int, subframe: float = 0.0) -> tuple[Scene, tuple[str, ...]]:
    bpy.context.scene.frame_set(frame, subframe=subframe)
    return sync.scene_from_depsgraph(bpy.context.evaluated_depsgraph_get(), CloudCache())


def counts(*frames: int) -> list[int]:
    return [shown(frame)[0].splat_count for frame in frames]
