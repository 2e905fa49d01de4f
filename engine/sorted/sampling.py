# SPDX-License-Identifier: GPL-3.0-or-later
"""Where in its pixel a sample lies: what both blending kernels are told."""

from __future__ import annotations

import warp as wp

STOP_TRANSMITTANCE = 1e-4  # a pixel that lets less light through is done


@wp.struct
class Sampling:
    """One sample position for the whole window, and the limit of opacity."""

    offset_px: wp.vec2  # of the sample from the pixel's corner
    corner: wp.vec2  # of the window in the frame [px]
    alpha_max: wp.float32
    width: wp.int32  # of the window [px]
    height: wp.int32
    columns: wp.int32  # of tiles
