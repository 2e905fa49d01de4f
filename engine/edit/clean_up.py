# SPDX-License-Identifier: GPL-3.0-or-later
"""Clean-up filters: what a scan has too much of. Each finds; `Mask.count` is the preview, `flags.delete` deletes."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ..errors import StippleError
from .editable_cloud import EditableCloud
from .mask import Mask
from .match_space import match_box
from .match_values import match_opacity, match_size
from .neighbours import match_sparse, typical_spacing


def find_floaters(
    cloud: EditableCloud, factor: float = 4.0, neighbours: int = 6, world_from_object: npt.ArrayLike | None = None
) -> Mask:
    """Splats with fewer than `neighbours` others within `factor` times the capture's typical spacing.

    Raises StippleError for a factor that is not positive or a capture of too few splats.
    """
    shown = cloud.shown().count()
    if shown <= neighbours:
        raise StippleError(
            f"{cloud.name}: none of the {shown:,} splats that are shown can have {neighbours} neighbors; ask for fewer "
            "neighbors or reveal more splats."
        )
    distance = factor * typical_spacing(cloud, neighbours, world_from_object)
    return match_sparse(cloud, distance, neighbours, world_from_object)


def find_oversized(cloud: EditableCloud, size: float, world_from_object: npt.ArrayLike | None = None) -> Mask:
    """Splats whose longest standard deviation is at least `size` [world units]."""
    return match_size(cloud, size, np.inf, world_from_object) & cloud.selectable()


def find_faint(cloud: EditableCloud, opacity: float = 1.0 / 255.0) -> Mask:
    """Splats of at most this opacity; at 1/255 and below a splat is never drawn."""
    return match_opacity(cloud, 0.0, opacity) & cloud.selectable()


def find_outside(
    cloud: EditableCloud, world_from_box: npt.ArrayLike, world_from_object: npt.ArrayLike | None = None
) -> Mask:
    """Splats whose mean is outside a crop: the cube -1 … 1 that `world_from_box` (3, 4) maps to the world."""
    return cloud.selectable() - match_box(cloud, world_from_box, world_from_object)
