# SPDX-License-Identifier: GPL-3.0-or-later
"""A splat in few bits: what Gaussian Point Splatting (doi 10.1145/3811272, §3.6) stores, within 16 + 1 + 4 bytes.

| part           | bits         | relative to                                           |
|----------------|--------------|-------------------------------------------------------|
| mean           | 23 + 22 + 23 | the group's box of means                              |
| log of scale   | 3 × 10       | the group's range                                     |
| principal axes | 3 × 10       | the cube that holds all rotations, see below          |
| opacity        | 8            | 0 … 1                                                 |
| base colour    | 3 × 10       | 0 … the group's brightest (without higher bands)      |
| higher bands   | 8 each       | the splat's own largest coefficient, kept as a float  |

Where we differ. The paper's ranges are the scene's, and one outlier ruins them; its harmonics are relative to band 0,
which a dark grey splat has at zero. And a splat's axes have no order and no sign, so 24 rotations draw the same splat:
the one that turns least lies within tan(π/8) along each axis of Rodrigues' vector, which makes 10 bits three times as
fine as "smallest three" in the same 30 (at most 0.10° off, measured).
"""

from __future__ import annotations

import warp as wp

wp.set_module_options({"enable_backward": False})

RODRIGUES_LIMIT = wp.constant(0.41421357)  # tan(π/8), of the least of 24 equivalent rotations, a little above
SMALLEST_SCALE = wp.constant(1e-30)  # a disc's thickness of 0 has no logarithm
LEVELS_10 = wp.constant(1023.0)
LEVELS_22 = wp.constant(4194303.0)
LEVELS_23 = wp.constant(8388607.0)
ROOT_HALF = wp.constant(0.70710678)


@wp.func
def quantised(value: wp.float32, low: wp.float32, span: wp.float32, levels: wp.float32) -> wp.uint32:
    """The nearest of `levels` + 1 steps from `low` to `low + span`; what lies outside is clipped."""
    part = float(0.0)
    if span > 0.0:
        part = wp.clamp((value - low) / span, 0.0, 1.0)
    return wp.uint32(part * levels + 0.5)


@wp.func
def larger_real(best: wp.quat, q: wp.quat, turn: wp.quat) -> wp.quat:
    """`turn`, if q · turn turns less than q · best."""
    if wp.abs((q * turn)[3]) > wp.abs((q * best)[3]) + 1e-7:
        return turn
    return best


@wp.func
def nearest_turn(q: wp.quat) -> wp.quat:
    """Of the 24 rotations that take a cube to itself, the one that makes q · turn turn least."""
    h = ROOT_HALF
    best = wp.quat(0.0, 0.0, 0.0, 1.0)
    for axis in range(3):
        half = wp.vec3(0.0, 0.0, 0.0)
        half[axis] = 1.0
        best = larger_real(best, q, wp.quat(half, 0.0))
        best = larger_real(best, q, wp.quat(h * half, h))
        best = larger_real(best, q, wp.quat(-h * half, h))
        edge = wp.vec3(h, h, h)
        edge[axis] = 0.0
        best = larger_real(best, q, wp.quat(edge, 0.0))
        edge[(axis + 1) % 3] = -h
        best = larger_real(best, q, wp.quat(edge, 0.0))
    for corner in range(8):
        x = wp.where((corner & 1) != 0, 0.5, -0.5)
        y = wp.where((corner & 2) != 0, 0.5, -0.5)
        z = wp.where((corner & 4) != 0, 0.5, -0.5)
        best = larger_real(best, q, wp.quat(x, y, z, 0.5))
    return best


@wp.func
def reordered(scale: wp.vec3, turn: wp.quat) -> wp.vec3:
    """Scales along the axes that `turn` leaves, moved and not computed: a needle's width keeps all its digits."""
    names = wp.quat_rotate_inv(turn, wp.vec3(1.0, 2.0, 4.0))
    result = wp.vec3()
    for axis in range(3):
        result[axis] = scale[int(wp.abs(names[axis]) * 0.5 + 0.25)]  # 1, 2, 4 -> 0, 1, 2
    return result


@wp.func
def pack_geometry(
    position: wp.vec3,
    scale: wp.vec3,
    rotation: wp.vec4,
    position_low: wp.vec3,
    position_span: wp.vec3,
    log_scale: wp.vec2,
) -> wp.vec4ui:
    """128 bits; `rotation` is w, x, y, z of a unit quaternion, `log_scale` the range's low end and span."""
    q = wp.quat(rotation[1], rotation[2], rotation[3], rotation[0])
    turn = nearest_turn(q)
    least = q * turn
    sorted_scale = reordered(scale, turn)
    x = quantised(position[0], position_low[0], position_span[0], LEVELS_23)
    y = quantised(position[1], position_low[1], position_span[1], LEVELS_22)
    z = quantised(position[2], position_low[2], position_span[2], LEVELS_23)
    s = wp.vec3ui()
    r = wp.vec3ui()
    for axis in range(3):
        log_s = wp.log(wp.max(sorted_scale[axis], SMALLEST_SCALE))
        s[axis] = quantised(log_s, log_scale[0], log_scale[1], LEVELS_10)
        tangent = least[axis] / least[3]
        r[axis] = quantised(tangent, -RODRIGUES_LIMIT, 2.0 * RODRIGUES_LIMIT, LEVELS_10)
    # x 23 | z low 9; z high 14 | y low 18; y high 4 | s0 10 | s1 10 | s2 low 8; s2 high 2 | r0 10 | r1 10 | r2 10
    a = x | (z << wp.uint32(23))
    b = (z >> wp.uint32(9)) | (y << wp.uint32(14))
    c = (y >> wp.uint32(18)) | (s[0] << wp.uint32(4)) | (s[1] << wp.uint32(14)) | (s[2] << wp.uint32(24))
    d = (s[2] >> wp.uint32(8)) | (r[0] << wp.uint32(2)) | (r[1] << wp.uint32(12)) | (r[2] << wp.uint32(22))
    return wp.vec4ui(a, b, c, d)


@wp.func
def bits(word: wp.uint32, first: wp.int32, count: wp.int32) -> wp.uint32:
    return (word >> wp.uint32(first)) & ((wp.uint32(1) << wp.uint32(count)) - wp.uint32(1))


@wp.func
def unpack_position(g: wp.vec4ui, low: wp.vec3, span: wp.vec3) -> wp.vec3:
    x = bits(g[0], 0, 23)
    z = bits(g[0], 23, 9) | (bits(g[1], 0, 14) << wp.uint32(9))
    y = bits(g[1], 14, 18) | (bits(g[2], 0, 4) << wp.uint32(18))
    part = wp.vec3(float(x) / LEVELS_23, float(y) / LEVELS_22, float(z) / LEVELS_23)
    return low + wp.cw_mul(part, span)


@wp.func
def unpack_scale(g: wp.vec4ui, log_scale: wp.vec2) -> wp.vec3:
    step = log_scale[1] / LEVELS_10
    s2 = bits(g[2], 24, 8) | (bits(g[3], 0, 2) << wp.uint32(8))
    return wp.vec3(
        wp.exp(log_scale[0] + step * float(bits(g[2], 4, 10))),
        wp.exp(log_scale[0] + step * float(bits(g[2], 14, 10))),
        wp.exp(log_scale[0] + step * float(s2)),
    )


@wp.func
def unpack_largest_scale(g: wp.vec4ui, log_scale: wp.vec2) -> wp.float32:
    """The largest entry of `unpack_scale`, to the bit, for one exponential instead of three."""
    s2 = bits(g[2], 24, 8) | (bits(g[3], 0, 2) << wp.uint32(8))
    largest = wp.max(wp.max(bits(g[2], 4, 10), bits(g[2], 14, 10)), s2)
    return wp.exp(log_scale[0] + log_scale[1] / LEVELS_10 * float(largest))


@wp.func
def unpack_rotation(g: wp.vec4ui) -> wp.vec4:
    """Unit quaternion w, x, y, z."""
    step = 2.0 * RODRIGUES_LIMIT / LEVELS_10
    t = wp.vec3(float(bits(g[3], 2, 10)), float(bits(g[3], 12, 10)), float(bits(g[3], 22, 10))) * step
    t = t - wp.vec3(RODRIGUES_LIMIT, RODRIGUES_LIMIT, RODRIGUES_LIMIT)
    w = 1.0 / wp.sqrt(1.0 + wp.dot(t, t))
    return wp.vec4(w, w * t[0], w * t[1], w * t[2])


@wp.func
def pack_colour(colour: wp.vec3, brightest: wp.float32) -> wp.uint32:
    """3 × 10 bits of a colour from 0 to `brightest`."""
    r = quantised(colour[0], 0.0, brightest, LEVELS_10)
    g = quantised(colour[1], 0.0, brightest, LEVELS_10)
    b = quantised(colour[2], 0.0, brightest, LEVELS_10)
    return r | (g << wp.uint32(10)) | (b << wp.uint32(20))


@wp.func
def unpack_colour(word: wp.uint32, brightest: wp.float32) -> wp.vec3:
    step = brightest / LEVELS_10
    return step * wp.vec3(float(bits(word, 0, 10)), float(bits(word, 10, 10)), float(bits(word, 20, 10)))


@wp.func
def pack_coefficient(value: wp.float32, largest: wp.float32) -> wp.uint32:
    """8 bits of a value from -`largest` to `largest`; 0 stays 0."""
    part = float(0.0)
    if largest > 0.0:
        part = wp.clamp(value / largest, -1.0, 1.0)
    return wp.uint32(wp.floor(part * 127.0 + 128.5))
