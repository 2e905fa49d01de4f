# SPDX-License-Identifier: GPL-3.0-or-later
"""Linked captures in Edit Splats, and what is kept of their edits."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import bpy
import numpy as np

from stipple.addon.linked_edits import found_edits
from stipple.engine.formats import read_splats

from .captures import add_camera, use_stipple
from .editing import activate
from .linked import link

COUNT = 3_000
LEFT = {"center": (-1, 0, 0), "radius": 1.0}


def edited_link(path: Path) -> Any:
    """The active object, a newly linked capture, and an undo stack that begins with it."""
    b_object = link(path)
    activate(b_object)
    assert bpy.ops.stipple.edit_mode_toggle() == {"FINISHED"}
    bpy.ops.ed.undo_push(message="Start")
    return b_object


def states(b_object: Any) -> np.ndarray:
    """The flags of the splats of a capture of `COUNT`."""
    found = found_edits(b_object.data, b_object.name)
    return np.zeros(COUNT, np.uint32) if found is None else found.edits.states()


def left_of(path: Path) -> np.ndarray:
    """Which splats of a file `LEFT` holds."""
    return np.linalg.norm(read_splats(path).cloud.position - (-1, 0, 0), axis=1) <= 1


def edit_everything() -> None:
    """Every kind of edit of the active capture."""
    bpy.ops.stipple.select_sphere(**LEFT)
    bpy.ops.stipple.rotate(value=0.6, axis=(0, 1, 0.3))
    bpy.ops.stipple.translate(value=(0.2, 0.1, -0.1))
    dab = {"name": "", "location": (0.3, -0.4, 0.2), "radius": 0.7}
    bpy.ops.stipple.paint(stroke=[dab], color=(0.9, 0.1, 0.1))
    bpy.ops.stipple.paint(stroke=[dab | {"location": (-0.3, 0.5, 0)}], mode="OPACITY", opacity=0.2)
    bpy.ops.stipple.select_sphere(center=(1, 0, 1), radius=0.8)
    bpy.ops.stipple.delete()


def edited_scene(path: Path) -> Any:
    """A linked capture with edits of every kind but opacities, in a scene to be rendered."""
    b_object = link(path)
    activate(b_object)
    add_camera()
    use_stipple()
    bpy.ops.stipple.edit_mode_toggle()
    bpy.ops.stipple.select_sphere(center=(-1, 0, 0), radius=1)
    bpy.ops.stipple.rotate(value=0.5)
    bpy.ops.stipple.paint(stroke=[{"name": "", "location": (0, 0, 0), "radius": 0.8}], color=(0.9, 0.1, 0.1))
    bpy.ops.stipple.select_sphere(center=(1, 0, 0), radius=0.9)
    bpy.ops.stipple.delete()
    return b_object


def load(path: Path) -> Any:
    bpy.ops.wm.open_mainfile(filepath=str(path))
    return bpy.data.objects.get("garden")


def edits_files(folder: Path) -> list[str]:
    return sorted(name for name in os.listdir(folder) if "edits" in name)


def damage(file: Path) -> None:
    data = bytearray(file.read_bytes())
    data[len(data) // 2] ^= 0xFF
    file.write_bytes(data)
