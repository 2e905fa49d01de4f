# SPDX-License-Identifier: GPL-3.0-or-later
"""All bytes of a cloud, to compare before and after."""

from __future__ import annotations

import numpy as np

from stipple.engine.edit.editable_cloud import EditableCloud

NAMES = (
    "position",
    "scale",
    "rotation",
    "opacity",
    "sh_dc",
    "sh_rest",
    "state",
    "base_dc",
    "base_rest",
    "base_opacity",
)


def every_byte(cloud: EditableCloud) -> dict[str, bytes]:
    """Every array, and zeros for paint where there is none yet: a layer without paint is no paint."""
    found = {name: cloud.array(name).numpy().tobytes() for name in NAMES}
    paint = cloud.array("paint").numpy() if cloud.has("paint") else np.zeros(cloud.splat_count, np.uint64)
    return found | {"paint": paint.tobytes()}


def assert_same(cloud: EditableCloud, before: dict[str, bytes]) -> None:
    now = every_byte(cloud)
    assert [name for name in before if now[name] != before[name]] == []
