# SPDX-License-Identifier: GPL-3.0-or-later
"""Where the selection is: pivots for transforms."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from .editable_cloud import EditableCloud
from .selection import selected_or_refuse

Point = npt.NDArray[np.float64]


def bounds(cloud: EditableCloud) -> tuple[Point, Point]:
    """Smallest and largest mean of the selection along each axis (3,) [object units]. Reads back.

    Raises StippleError when nothing is selected; so does `median`.
    """
    means = _means(cloud)
    return means.min(axis=0).astype(np.float64), means.max(axis=0).astype(np.float64)


def median(cloud: EditableCloud) -> Point:
    """Blender's *Median Point*: the mean of the selected means (3,) [object units]. Reads back."""
    return _means(cloud).mean(axis=0, dtype=np.float64)


def _means(cloud: EditableCloud) -> npt.NDArray[np.float32]:
    return cloud.host("position")[selected_or_refuse(cloud, "measure").numpy()]
