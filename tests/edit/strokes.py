# SPDX-License-Identifier: GPL-3.0-or-later
"""A stroke of paint through the middle of the test captures."""

from __future__ import annotations

from stipple.engine.edit.brush import Brush
from stipple.engine.edit.editable_cloud import EditableCloud
from stipple.engine.edit.paint_stroke import PaintStroke

COLOUR = (0.9, 0.35, 0.1)
DABS = [((0.0, 0.0, 4.0), 1.6), ((0.5, 0.1, 4.2), 1.8), ((1.0, 0.0, 4.0), 1.2)]


def stroke(cloud: EditableCloud, brush: Brush, dabs: list = DABS, **options: object) -> PaintStroke:
    result = PaintStroke(cloud, brush, **options)
    for centre, radius in dabs:
        result.dab(centre, radius)
    return result
