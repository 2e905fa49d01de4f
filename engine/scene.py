# SPDX-License-Identifier: GPL-3.0-or-later
"""What is in front of the camera: plain values, no Blender and no device."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from .errors import StippleError
from .look import Look
from .splats import SplatCloud

if TYPE_CHECKING:
    from .cloud_upload import DeviceSource

Affine = tuple[tuple[float, ...], ...]  # three rows of four numbers
IDENTITY: Affine = ((1.0, 0.0, 0.0, 0.0), (0.0, 1.0, 0.0, 0.0), (0.0, 0.0, 1.0, 0.0))


def identity_transform() -> npt.NDArray[np.float64]:
    return np.eye(3, 4)


@dataclass(frozen=True, eq=False)
class SplatStates:
    """The flags of a cloud that is edited: `words` (N,) uint32, bits as in `edit.state`. Recognised by identity.

    They stand in the host's order: a cloud's own, or of a capture that stays in its file that of the file's splats,
    without those that cannot be rendered.
    Hidden and deleted splats are not drawn, selected ones are drawn highlighted.
    """

    words: npt.NDArray[np.uint32]


@dataclass(frozen=True, eq=False)
class Instance:
    """One placement of a cloud. Instances of one cloud share its memory on the device.

    - `cloud`: splats in host memory, or what makes itself on the device.
    - `world_from_object` (3, 4) float64: any affine map; its linear part may scale unevenly, shear or mirror.
    - `name`: of the object, for messages.
    - `object_index`: the host's pass index, for masks.
    - `look`: how it is graded, cropped and displayed; changes neither cloud nor memory.
    - `states`: flags of an edit, or None. Clouds that the host holds are drawn in full precision then; of others only
      captures that stay in their file may have them.
    """

    cloud: SplatCloud | DeviceSource
    world_from_object: npt.NDArray[np.float64] = field(default_factory=identity_transform)
    name: str = ""
    object_index: int = 0
    look: Look = Look()  # noqa: RUF009 - frozen
    states: SplatStates | None = None


@dataclass(frozen=True, eq=False)
class EnvironmentImage:
    """An equirectangular picture of everything around; equal only to itself, so that it is uploaded once.

    `pixels` (H, W, 3): C-contiguous float32, scene-linear Rec.709 light (negative outside that gamut), rows from the
    zenith to the nadir. Raises StippleError for another shape or type, and for values that are not finite.
    """

    pixels: npt.NDArray[np.float32]
    name: str = "environment"

    def __post_init__(self) -> None:
        pixels = self.pixels
        if pixels.ndim != 3 or pixels.shape[2] != 3 or pixels.size == 0:
            raise StippleError(f"{self.name}: the environment is {pixels.shape}; give (height, width, 3) pixels.")
        if pixels.dtype != np.float32 or not pixels.flags.c_contiguous:
            raise StippleError(f"{self.name}: the environment is {pixels.dtype}; give contiguous float32 pixels.")
        if not np.isfinite(pixels).all():
            raise StippleError(f"{self.name}: the environment holds values that are not finite; clean the image.")


@dataclass(frozen=True)
class Environment:
    """An image placed around the scene; compares equal as long as it looks the same.

    - `environment_from_world`: 3×4; its affine map of a unit direction in the world is looked up in the image, whose
      space has the zenith at +z and the image's centre at +x; to the right of the centre is −y.
    - `strength`: the light's factor.
    """

    image: EnvironmentImage
    environment_from_world: Affine = IDENTITY
    strength: float = 1.0

    def __post_init__(self) -> None:
        affine = np.array(self.environment_from_world, np.float64)
        if affine.shape != (3, 4) or not np.isfinite(affine).all() or not np.isfinite(self.strength):
            raise StippleError(f"{self.image.name}: give a finite 3×4 environment_from_world and a finite strength.")


Background = tuple[float, float, float] | Environment | None
"""An sRGB-encoded colour, an environment, or None for a transparent film."""


@dataclass(frozen=True, eq=False)
class Scene:
    """Instances and what is behind them.

    `background` is an sRGB-encoded colour, an environment, or None for a transparent film. Overlapping instances mix
    as if they were one cloud.
    """

    instances: tuple[Instance, ...]
    background: Background = None

    @property
    def splat_count(self) -> int:
        """Splats over all instances, each placement counted."""
        return sum(instance.cloud.splat_count for instance in self.instances)
