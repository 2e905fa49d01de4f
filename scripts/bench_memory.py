# SPDX-License-Identifier: GPL-3.0-or-later
"""Count what a scene takes on the device, from the arrays that are allocated."""

from __future__ import annotations

from typing import Any

import warp as wp

from stipple.engine.device_cloud import DeviceCloud
from stipple.engine.groups import SplatGroups
from stipple.engine.renderer import Renderer
from stipple.engine.scene import Scene

# Buffers that grow with the picture, by how their names begin; all others grow with the splats or groups.
OF_THE_PICTURE = ("film_", "visibility", "depth_pyramid")


def array_bytes(struct: Any, names: Any) -> int:
    """Of the arrays among the members of a Warp struct."""
    members = (getattr(struct, name) for name in names)
    return sum(member.capacity for member in members if isinstance(member, wp.array) and member.size)


def memory(renderer: Renderer, scene: Scene, storage: str) -> dict[str, int]:
    """Bytes of the splats, of their groups, of working buffers that grow with splats, and of the picture's."""
    clouds = {id(cloud): cloud for cloud in renderer.device_clouds(scene, storage, lambda fraction, text: None)}
    held = renderer.buffers.bytes_by_name()
    picture = sum(size for name, size in held.items() if name.startswith(OF_THE_PICTURE))
    return {
        "splats": sum(array_bytes(cloud, DeviceCloud.vars) for cloud in clouds.values()),
        "groups": sum(array_bytes(cloud.groups, SplatGroups.vars) for cloud in clouds.values()),
        "working": sum(held.values()) - picture,
        "picture": picture,
    }
