# SPDX-License-Identifier: GPL-3.0-or-later
"""Groups of consecutive splats and what bounds them, so that whole groups are left out at once.

Gaussian Point Splatting (doi 10.1145/3811272, §3.5) keeps one box per group. But a splat's extent on the screen follows
from the first-order projection of *its own* covariance, which the projection of a box around it does not bound; so we
keep the box of the means and, apart, the largest standard deviation along each axis and the largest opacity. From these
follow both the box that holds all truncated splats (`group_box`) and a bound of their ellipses (`culling`).
"""

from __future__ import annotations

import numpy as np
import warp as wp

wp.set_module_options({"enable_backward": False})

SMALLEST_SHIFT = 8  # 256 splats a group, the more the larger the cloud is
MOST_GROUPS = 1 << 20


@wp.struct
class SplatGroups:
    """Groups of 2**shift consecutive splats in object space; group of splat i: i >> shift."""

    count: wp.int32
    shift: wp.int32
    low: wp.array(dtype=wp.vec3)  # of the means
    high: wp.array(dtype=wp.vec3)
    sigma: wp.array(dtype=wp.vec3)  # largest standard deviation along x, y, z
    opacity: wp.array(dtype=wp.float32)  # largest; -1 where no splat is valid
    # What the packed values of quantised splats are relative to
    packed_low: wp.array(dtype=wp.vec3)
    packed_span: wp.array(dtype=wp.vec3)
    packed_log_scale: wp.array(dtype=wp.vec2)  # low end, span
    packed_brightest: wp.array(dtype=wp.float32)


def shift_for(splat_count: int) -> int:
    """log₂ of the splats per group: 8, and more where that would make over a million groups."""
    return max(SMALLEST_SHIFT, int(np.ceil(np.log2(max(1, splat_count) / MOST_GROUPS))))


@wp.func
def group_reach(opacity: wp.float32, alpha_min: wp.float32) -> wp.float32:
    """How many standard deviations from its mean the least faint splat ends: where opacity falls to `alpha_min`."""
    return wp.sqrt(2.0 * wp.max(wp.log(opacity / alpha_min), 0.0) + 1e-4)


@wp.struct
class Box:
    low: wp.vec3
    high: wp.vec3


@wp.func
def group_box(groups: SplatGroups, group: wp.int32, alpha_min: wp.float32) -> Box:
    """The axis-aligned box in object space that holds a group's splats up to where they end."""
    margin = group_reach(groups.opacity[group], alpha_min) * groups.sigma[group]
    box = Box()
    box.low = groups.low[group] - margin
    box.high = groups.high[group] + margin
    return box
