# SPDX-License-Identifier: GPL-3.0-or-later
"""Light of a picture in host memory, for tests that compare what hosts are given."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import warp as wp

from stipple.engine.light import light_from_display


def light_of(
    rgba: npt.NDArray[np.float32], working_space: str = "Rec.709", device: str = "cpu"
) -> npt.NDArray[np.float32]:
    """`light_from_display` of a picture, which stays as it is."""
    on_device = wp.array(rgba, dtype=wp.vec4, device=device)
    light_from_display(on_device, working_space)
    return np.array(on_device.numpy())
