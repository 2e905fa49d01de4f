# SPDX-License-Identifier: GPL-3.0-or-later
"""Notices that Python removed, cleared or moved crops, of which Blender tells nobody: lists have no update function."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import bpy

from ..engine.scene import Instance


def cropped_objects(instances: Iterable[Instance]) -> frozenset[str]:
    """The names of objects that are cropped in what was read; references to them would not survive an undo."""
    return frozenset(instance.name for instance in instances if instance.look.crops)


def with_other_lists(names: Iterable[str], depsgraph: Any) -> list[str]:
    """Which of the objects have another list of crops than Blender has evaluated."""
    found = ((name, bpy.data.objects.get(name)) for name in names)
    return [
        name
        for name, b_object in found
        if b_object is not None and _list_of(b_object) != _list_of(b_object.evaluated_get(depsgraph))
    ]


def evaluate_again(names: Iterable[str]) -> None:
    """Tells Blender that the objects have changed; viewports then read them. Not while it draws."""
    for b_object in map(bpy.data.objects.get, names):
        if b_object is not None:
            b_object.update_tag(refresh={"OBJECT"})


def _list_of(b_object: Any) -> list[int]:
    volumes = (b_crop.object for b_crop in b_object.stipple.crops)
    return [0 if b_volume is None else b_volume.original.session_uid for b_volume in volumes]
