# SPDX-License-Identifier: GPL-3.0-or-later
"""Linked captures for tests: made, lost, and as they reach the engine."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import bpy

from stipple.addon.residency import CloudCache
from stipple.addon.sync import scene_from_depsgraph


def link(path: Path | str, **options: Any) -> Any:
    """The object of a newly linked capture, unturned."""
    assert bpy.ops.import_scene.splats(filepath=str(path), link=True, up_axis="Z", **options) == {"FINISHED"}
    return bpy.context.view_layer.objects.active


def synced() -> list[Any]:
    depsgraph = bpy.context.evaluated_depsgraph_get()
    return list(scene_from_depsgraph(depsgraph, CloudCache())[0].instances)


def save(path: Path, **options: Any) -> None:
    bpy.ops.wm.save_as_mainfile(filepath=str(path), compress=False, **options)


def broken(path: Path) -> Path:
    """Moves the file away; returns where it is."""
    away = path.parent / "away" / path.name
    away.parent.mkdir(exist_ok=True)
    return Path(shutil.move(path, away))
