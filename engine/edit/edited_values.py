# SPDX-License-Identifier: GPL-3.0-or-later
"""The values of a capture's edits put on a cloud: `at` numbers its splats, and nothing else of it changes."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
import warp as wp

from .affine import Matrix
from .editable_cloud import EditableCloud
from .paint_layer import OpacityDiff, PaintDiff, begin_colour_layer, begin_opacity_layer
from .transform import splat_map

Rows = npt.NDArray[np.int32]


def put_values(cloud: EditableCloud, name: str, at: Rows, values: npt.NDArray[Any], matrices: Matrix) -> None:
    """What `name`, one of `capture_edits.VALUES`, keeps of some splats; transforms come before paint.

    Raises StippleError when memory runs out.
    """
    if at.size == 0:
        return
    if name == "moved_rows":
        _move(cloud, at, values, matrices)
        return
    rows = wp.array(at, dtype=wp.int32, device=cloud.device)
    if name == "painted_rows":
        begin_colour_layer(cloud)
        PaintDiff(rows, wp.array(values, dtype=wp.uint64, device=cloud.device)).apply(cloud)
    else:
        begin_opacity_layer(cloud)
        OpacityDiff(rows, wp.array(values, dtype=wp.float32, device=cloud.device)).apply(cloud)


def _move(cloud: EditableCloud, at: Rows, moved_by: Rows, matrices: Matrix) -> None:
    """Harmonics turn along where the cloud has them."""
    for k in np.unique(moved_by):
        forward = splat_map(cloud, matrices[k])
        rows = wp.array(at[moved_by == k], dtype=wp.int32, device=cloud.device)
        arrays = {part: cloud.writable(part) for part in forward.parts}
        forward.run(rows.size, rows, arrays, rows, arrays)
        cloud.touched(*forward.parts)
