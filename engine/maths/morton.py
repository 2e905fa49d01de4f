# SPDX-License-Identifier: GPL-3.0-or-later
"""A splat's place along a space-filling curve: shell, then 57 bits of Morton code.

Outliers must not take the curve's resolution from the rest. A coordinate x, in units of the capture's spread from its
centre, is contracted to x / (1 + |x|), which never clips; and splats are told apart by shells, each 16 times as far as
the one before, so that no group of neighbours in the order has both a splat of the capture and one at 2e7.
"""

from __future__ import annotations

import warp as wp

wp.set_module_options({"enable_backward": False})

SHELL_COUNT = 32  # 16^32 spreads, more than a float holds
MORTON_BITS = 57
AXIS_LEVELS = wp.constant(524287.0)  # 19 bits


@wp.func
def spread_bits(value: wp.int64) -> wp.int64:
    """Two zeros between each of the lowest 21 bits."""
    v = value & wp.int64(0x1FFFFF)
    v = (v | (v << wp.int64(32))) & wp.int64(0x1F00000000FFFF)
    v = (v | (v << wp.int64(16))) & wp.int64(0x1F0000FF0000FF)
    v = (v | (v << wp.int64(8))) & wp.int64(0x100F00F00F00F00F)
    v = (v | (v << wp.int64(4))) & wp.int64(0x10C30C30C30C30C3)
    return (v | (v << wp.int64(2))) & wp.int64(0x1249249249249249)


@wp.func
def shell_of(x: wp.vec3, scale: wp.float32) -> wp.int32:
    """0 for a splat within 16 spreads and no larger than that, 1 within 256, …"""
    distance = wp.max(wp.max(wp.abs(x)), scale)
    return wp.clamp(int(wp.floor(wp.log2(wp.max(distance, 1.0)) * 0.25)), 0, SHELL_COUNT - 1)


@wp.func
def morton_code(position: wp.vec3, largest_scale: wp.float32, centre: wp.vec3, spread: wp.float32) -> wp.int64:
    """Shell above Morton code, a positive 64-bit integer."""
    x = (position - centre) / spread
    code = wp.int64(shell_of(x, largest_scale / spread)) << wp.int64(MORTON_BITS)
    for axis in range(3):
        contracted = x[axis] / (1.0 + wp.abs(x[axis]))
        cell = wp.int64((0.5 + 0.5 * contracted) * AXIS_LEVELS)
        code = code | (spread_bits(cell) << wp.int64(axis))
    return code
