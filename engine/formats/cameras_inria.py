# SPDX-License-Identifier: GPL-3.0-or-later
"""INRIA's `cameras.json`, as the reference trainer of 3D Gaussian splatting writes it next to a capture."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from ..camera import INRIA_NEAR
from .cameras_entry import Entry, Fields, camera_from_world_of, entry_mapping


def parse(document: list[Any], path: Path) -> list[Entry]:
    """Cameras of the list, in its order.

    Each object has `width`, `height`, `fx`, `fy` [px], `position` (3) and `rotation` (3×3, world-from-camera: its
    columns are the camera's right, down and forward in the world). The layout has no principal point because the
    trainer assumes the centre, (width / 2, height / 2) with the first pixel's centre at 0.5; `cx` and `cy` are used
    where another program added them. Splats nearer than 0.2 world units are not shown, as in the trainer.

    Raises StippleError naming the file, the camera and the key.
    """
    return [_parse_one(Fields(path, index, entry_mapping(path, index, item))) for index, item in enumerate(document)]


def _parse_one(fields: Fields) -> Entry:
    rotation = fields.matrix("rotation", (3, 3))
    fields.check_rotation("rotation", rotation)
    width, height = fields.size("width"), fields.size("height")
    camera = fields.camera(
        camera_from_world_of(rotation, fields.matrix("position", (3,))),
        width=width,
        height=height,
        fx=fields.positive("fx"),
        fy=fields.positive("fy"),
        cx=fields.number("cx", width / 2),
        cy=fields.number("cy", height / 2),
        near=INRIA_NEAR,
    )
    name = fields.value("img_name") if fields.has("img_name") else fields.index
    return Entry(camera, str(name))
