# SPDX-License-Identifier: GPL-3.0-or-later
"""The light on a generated city: a sun with shadows, a sky that streets see a part of, and how colours are encoded."""

from __future__ import annotations

import warp as wp

from . import city_plan

wp.set_module_options({"enable_backward": False})

CELL = wp.constant(city_plan.CELL)
SUN = wp.constant(wp.vec3(-0.455, -0.545, 0.704))  # a unit vector towards it
SUN_COLOUR = wp.constant(wp.vec3(2.15, 1.95, 1.62))
SKY_COLOUR = wp.constant(wp.vec3(0.50, 0.60, 0.78))
SHADOW_STEPS = 12


@wp.func
def height_at(heights: wp.array2d(dtype=wp.float32), half: wp.vec2, x: wp.float32, y: wp.float32) -> wp.float32:
    column, row = int(wp.floor((x + half[0]) / CELL)), int(wp.floor((y + half[1]) / CELL))
    if column < 0 or row < 0 or column >= heights.shape[1] or row >= heights.shape[0]:
        return 0.0
    return heights[row, column]


@wp.func
def sunlight(
    heights: wp.array2d(dtype=wp.float32), half: wp.vec2, highest: wp.float32, p: wp.vec3, dice: wp.float32
) -> wp.float32:
    """0 … 1: how much of the sun is seen from `p`, walking towards it in ever longer steps over the map of heights."""
    step = 0.9 + 0.8 * dice
    distance = float(0.5) * step
    for _ in range(SHADOW_STEPS):
        q = p + distance * SUN
        if q[2] > highest:
            return 1.0
        over = height_at(heights, half, q[0], q[1]) - q[2]
        if over > 0.0:
            return wp.clamp(1.0 - over, 0.0, 1.0)
        distance += step
        step *= 1.32
    return 1.0


@wp.func
def openness(heights: wp.array2d(dtype=wp.float32), half: wp.vec2, p: wp.vec3, normal: wp.vec3) -> wp.float32:
    """How much of the sky a place sees, from what stands 5 m around it."""
    q = p + 2.5 * normal
    hidden = float(0.0)
    for k in range(4):
        x = q[0] + wp.where(k < 2, 5.0, -5.0)
        y = q[1] + wp.where(k % 2 == 0, 5.0, -5.0)
        hidden += wp.clamp((height_at(heights, half, x, y) - q[2]) * 0.06, 0.0, 1.0)
    return (1.0 - 0.17 * hidden) * (0.72 + 0.28 * normal[2])


@wp.func
def encoded(linear: wp.vec3) -> wp.vec3:
    """sRGB-encoded, with a soft shoulder in place of clipping."""
    c = wp.vec3()
    for k in range(3):
        v = wp.max(linear[k], 0.0)
        c[k] = wp.pow(v / (1.0 + 0.28 * v), 0.4545)
    return c
