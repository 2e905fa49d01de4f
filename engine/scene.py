# SPDX-License-Identifier: GPL-3.0-or-later
"""What is in front of the camera: plain values, no Blender and no device."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from .splats import SplatCloud

if TYPE_CHECKING:
    from .cloud_upload import DeviceSource


def identity_transform() -> npt.NDArray[np.float64]:
    return np.eye(3, 4)


@dataclass(frozen=True, eq=False)
class Instance:
    """One placement of a cloud. Instances of one cloud share its memory on the device.

    - `cloud`: splats in host memory, or what makes itself on the device.
    - `world_from_object` (3, 4) float64: any affine map; its linear part may scale unevenly, shear or mirror.
    - `name`: of the object, for messages.
    - `object_index`: the host's pass index, for masks.
    """

    cloud: SplatCloud | DeviceSource
    world_from_object: npt.NDArray[np.float64] = field(default_factory=identity_transform)
    name: str = ""
    object_index: int = 0


@dataclass(frozen=True, eq=False)
class Scene:
    """Instances and what is behind them.

    `background` is an sRGB-encoded colour, or None for a transparent film. Overlapping instances mix as if
    they were one cloud.
    """

    instances: tuple[Instance, ...]
    background: tuple[float, float, float] | None = None

    @property
    def splat_count(self) -> int:
        """Splats over all instances, each placement counted."""
        return sum(instance.cloud.splat_count for instance in self.instances)
