# SPDX-License-Identifier: GPL-3.0-or-later
"""What Solid shading shows of a capture: some of its splats as coloured points. NumPy and datablocks; no drawing."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from ..engine.edit.state_bits import DELETED, HIDDEN, HIGHLIGHT, LOCKED, SELECTED
from ..engine.splats import SH_C0
from .splat_data import BASE, display_radius, read_attribute, splat_count_of

FloatArray = npt.NDArray[np.float32]

MOST_POINTS = 300_000  # of one datablock: what a modest graphics card redraws without being noticed
OVERLAY_GAMMA = 2.2  # Blender's overlays hold color^2.2 of the display, whatever the view transform
FAINTEST = 1 / 255  # opacity below which a splat is never seen


@dataclass(frozen=True, eq=False)
class OverlayPoints:
    """Any number of the first points is spread evenly over the capture, so that fewer can be drawn.

    - `place` (N, 4): position and radius [object units].
    - `colour` (N, 4): display color with the overlays' gamma taken off, opaque.
    """

    place: FloatArray
    colour: FloatArray


def overlay_points(
    b_data: Any, name: str, most: int = MOST_POINTS, states: npt.NDArray[np.uint32] | None = None
) -> OverlayPoints:
    """At most `most` points of a datablock: base colors without view dependence, and the radii Blender draws.

    `states` (N,) are the flags that count: hidden and deleted points are left out, selected ones are tinted as in
    Rendered shading. Where splats are left out the others grow by as much as keeps a surface closed. Those that cannot
    be rendered or seen are left out. Raises StippleError, naming `name`, for a capture with broken attributes.
    """
    chosen = _spread(splat_count_of(b_data), most)
    position, base = read_attribute(b_data, "position", name)[chosen], read_attribute(b_data, BASE, name)[chosen]
    radius = _radius(b_data, name)[chosen] * np.sqrt(max(1.0, splat_count_of(b_data) / max(1, len(chosen))))
    seen = np.isfinite(position).all(axis=1) & np.isfinite(base).all(axis=1) & (base[:, 3] >= FAINTEST)
    seen &= np.isfinite(radius) & (radius >= 0)
    words = np.zeros(len(chosen), np.uint32) if states is None else states[chosen]
    seen &= (words & np.uint32(HIDDEN | DELETED)) == 0
    encoded = np.clip(0.5 + SH_C0 * base[seen, :3], 0, 1)
    acting = (words[seen] & np.uint32(SELECTED | LOCKED)) == SELECTED
    encoded[acting] = 0.5 * (encoded[acting] + np.array(HIGHLIGHT, np.float32))
    colour = np.ones((len(encoded), 4), np.float32)
    colour[:, :3] = encoded**OVERLAY_GAMMA
    place = np.concatenate([position[seen], radius[seen, None]], axis=1, dtype=np.float32)
    return OverlayPoints(np.ascontiguousarray(place), colour)


def _spread(count: int, most: int) -> npt.NDArray[np.int64]:
    """Evenly spaced indices in an order that leaves any beginning of it even as well."""
    kept = min(count, most)
    indices = np.arange(kept, dtype=np.int64) * count // max(1, kept)
    return np.random.default_rng(0).permutation(indices)


def _radius(b_data: Any, name: str) -> FloatArray:
    if "radius" in b_data.attributes:  # what Blender draws and selects: points of another size would not cover it
        return read_attribute(b_data, "radius", name)[:, 0]
    return display_radius(read_attribute(b_data, "scale", name), read_attribute(b_data, BASE, name)[:, 3])
