# SPDX-License-Identifier: GPL-3.0-or-later
"""How the surfaces of a generated city look: base colour, gloss and relief at a place."""

from __future__ import annotations

import warp as wp

from stipple.engine.maths.random import pcg3d

from . import city_plan

wp.set_module_options({"enable_backward": False})

FIELD = wp.constant(city_plan.FIELD)
STREET = wp.constant(city_plan.STREET)
COURTYARD = wp.constant(city_plan.COURTYARD)
FACADE = wp.constant(city_plan.FACADE)
CURTAIN_WALL = wp.constant(city_plan.CURTAIN_WALL)
FLAT_ROOF = wp.constant(city_plan.FLAT_ROOF)
TILED_ROOF = wp.constant(city_plan.TILED_ROOF)
TREE = wp.constant(city_plan.TREE)
PITCH_X, PITCH_Y = wp.constant(float(city_plan.PITCH[0])), wp.constant(float(city_plan.PITCH[1]))
STREET_WIDTH = wp.constant(city_plan.STREET_WIDTH)
ROADWAY = wp.constant(city_plan.STREET_WIDTH / 2 - city_plan.PAVEMENT_WIDTH)  # half its width [m]

GROUND_FLOOR = wp.constant(4.2)  # storeys [m]
STOREY = wp.constant(3.2)


@wp.struct
class Material:
    """Linear colour of the surface, its mirror-like part, and how far it lies behind the plane [m]."""

    albedo: wp.vec3
    gloss: wp.float32
    recess: wp.float32


@wp.struct
class Spot:
    """Where on a surface: metres along its sides, its size [m], the place in model space, and what is random in it."""

    kind: wp.int32
    seed: wp.uint32
    across: wp.float32
    up: wp.float32
    width: wp.float32
    height: wp.float32
    position: wp.vec3


@wp.func
def random_of(a: wp.int32, b: wp.int32, seed: wp.uint32) -> wp.vec3:
    """Three numbers in 0 … 1 for a pair of integers."""
    bits = pcg3d(wp.vec3ui(wp.uint32(a), wp.uint32(b), seed))
    return wp.vec3(float(bits[0]), float(bits[1]), float(bits[2])) * 2.3283064e-10


@wp.func
def smooth_noise(x: wp.float32, y: wp.float32, seed: wp.uint32) -> wp.float32:
    """0 … 1, varying over a unit."""
    column, row = wp.floor(x), wp.floor(y)
    i, j = int(column), int(row)
    s, t = x - column, y - row
    s, t = s * s * (3.0 - 2.0 * s), t * t * (3.0 - 2.0 * t)
    low = wp.lerp(random_of(i, j, seed)[0], random_of(i + 1, j, seed)[0], s)
    high = wp.lerp(random_of(i, j + 1, seed)[0], random_of(i + 1, j + 1, seed)[0], s)
    return wp.lerp(low, high, t)


@wp.func
def within(value: wp.float32, low: wp.float32, high: wp.float32) -> wp.bool:
    return value >= low and value < high


@wp.func
def wall_colour(seed: wp.uint32) -> wp.vec3:
    """Of plaster, sandstone or brick."""
    dice = random_of(1, 0, seed)
    tone = 0.75 + 0.35 * dice[1]
    if dice[0] < 0.3:
        return tone * wp.vec3(0.62, 0.52, 0.38)
    if dice[0] < 0.5:
        return tone * wp.vec3(0.42, 0.17, 0.10)
    if dice[0] < 0.68:
        return tone * wp.vec3(0.60, 0.58, 0.53)
    if dice[0] < 0.82:
        return tone * wp.vec3(0.58, 0.40, 0.28)
    return tone * wp.vec3(0.40, 0.46, 0.46)


@wp.func
def glass(spot: Spot, bay: wp.int32, storey: wp.int32) -> Material:
    """A dark pane, some with curtains behind."""
    m = Material()
    dice = random_of(bay, storey, spot.seed + wp.uint32(7))
    m.albedo = wp.vec3(0.035, 0.045, 0.055)
    if dice[0] < 0.35:
        m.albedo = (0.10 + 0.25 * dice[1]) * wp.vec3(1.0, 0.95, 0.85)
    m.gloss = 0.55 + 0.25 * dice[2]
    m.recess = 0.22
    return m


@wp.func
def facade(spot: Spot) -> Material:
    """Windows in storeys and bays over shops; a cornice on top."""
    m = Material()
    z = spot.position[2]
    wall = wall_colour(spot.seed)
    m.albedo = wall * (0.9 + 0.2 * smooth_noise(0.7 * spot.across, 0.5 * z, spot.seed))
    bays = wp.max(1.0, wp.floor(spot.width / 3.1 + 0.5))
    x = spot.across * bays / spot.width
    bay = int(wp.floor(x))
    x = x - wp.floor(x)
    to_top = spot.height - spot.up
    if spot.height > 8.0 and to_top < 0.7:
        m.albedo = 0.5 * wall + 0.45 * wp.vec3(0.55, 0.53, 0.5)
        m.recess = -0.25
        return m
    if z < GROUND_FLOOR:
        if z > 3.3:  # signs
            sign = random_of(bay / 3, 5, spot.seed)
            m.albedo = wp.lerp(0.5 * wall, 0.45 * wp.cw_mul(sign, sign), 0.55)
            m.recess = -0.08
        elif z > 0.5 and within(x, 0.08, 0.92):
            m = glass(spot, bay, 0)
        else:
            m.albedo = 0.45 * wall + wp.vec3(0.05, 0.05, 0.05)
        return m
    storey = int((z - GROUND_FLOOR) / STOREY)
    y = (z - GROUND_FLOOR) / STOREY - float(storey)
    if to_top < 1.4 and spot.height > 8.0:
        return m
    if within(x, 0.27, 0.73) and within(y, 0.22, 0.78):
        m = glass(spot, bay, storey + 1)
    elif within(x, 0.19, 0.81) and within(y, 0.13, 0.86):  # the frame, and a sill
        m.albedo = 0.35 * wall + 0.6 * wp.vec3(0.62, 0.6, 0.56)
        m.recess = -0.06
    elif y < 0.07:
        m.albedo = 0.82 * wall
    return m


@wp.func
def curtain_wall(spot: Spot) -> Material:
    """An office tower: glass between mullions and bands."""
    z = spot.position[2]
    storey = int(z / STOREY)
    y = z / STOREY - float(storey)
    bays = wp.max(1.0, wp.floor(spot.width / 1.6 + 0.5))
    x = spot.across * bays / spot.width
    bay = int(wp.floor(x))
    x = x - wp.floor(x)
    tint = random_of(3, 0, spot.seed)
    m = glass(spot, bay, storey)
    m.albedo = 0.6 * m.albedo + 0.05 * tint
    if y < 0.24:
        m.albedo = (0.25 + 0.4 * tint[0]) * wp.vec3(0.9, 0.92, 0.95)
        m.gloss = 0.1
        m.recess = 0.0
    elif x < 0.14:
        m.albedo = wp.vec3(0.2, 0.21, 0.22)
        m.gloss = 0.1
        m.recess = -0.05
    return m


@wp.func
def street(spot: Spot, half: wp.vec2) -> Material:
    """Roadway with markings and zebra crossings, pavements with slabs."""
    m = Material()
    p = spot.position
    x = p[0] + half[0]
    y = p[1] + half[1]
    x = x - PITCH_X * wp.floor(x / PITCH_X)
    y = y - PITCH_Y * wp.floor(y / PITCH_Y)
    from_x, from_y = x - 0.5 * STREET_WIDTH, y - 0.5 * STREET_WIDTH  # from the middles of the streets
    in_x, in_y = wp.abs(from_x) < ROADWAY, wp.abs(from_y) < ROADWAY
    grain = smooth_noise(1.3 * p[0], 1.3 * p[1], wp.uint32(11)) + 0.5 * smooth_noise(
        0.2 * p[0], 0.2 * p[1], wp.uint32(5)
    )
    if not in_x and not in_y:
        slab = random_of(int(wp.floor(p[0])), int(wp.floor(p[1])), wp.uint32(3))[0]
        m.albedo = (0.30 + 0.05 * grain + 0.05 * slab) * wp.vec3(1.0, 0.96, 0.9)
        m.recess = -0.14
        return m
    m.albedo = (0.075 + 0.035 * grain) * wp.vec3(1.0, 1.0, 1.03)
    lateral, along = from_x, from_y
    if in_y:
        lateral, along = from_y, from_x
    if in_x and in_y:
        return m
    beyond = wp.abs(along) - 0.5 * STREET_WIDTH
    stripe = lateral - wp.floor(lateral)
    white = within(beyond, 0.4, 3.4) and stripe < 0.5
    white = white or within(beyond, 4.0, 4.5)
    dash = 0.2 * along - wp.floor(0.2 * along)
    white = white or (beyond > 4.5 and wp.abs(lateral) < 0.14 and dash < 0.55)
    white = white or (beyond > 4.5 and wp.abs(wp.abs(lateral) - 2.9) < 0.1)  # where cars park
    if white:
        m.albedo = wp.vec3(0.55, 0.55, 0.52) * (0.75 + 0.25 * grain)
    return m


@wp.func
def land(spot: Spot) -> Material:
    """Grass and earth of courtyards and parks; fields outside in the colours of crops."""
    m = Material()
    p = spot.position
    fine = smooth_noise(0.9 * p[0], 0.9 * p[1], wp.uint32(21))
    coarse = smooth_noise(0.12 * p[0], 0.12 * p[1], wp.uint32(22))
    m.albedo = wp.lerp(wp.vec3(0.07, 0.13, 0.035), wp.vec3(0.16, 0.19, 0.06), 0.5 * fine + 0.5 * coarse)
    if spot.kind == FIELD:
        crop = random_of(9, 0, spot.seed)
        m.albedo = (0.7 + 0.3 * fine) * wp.lerp(wp.vec3(0.08, 0.13, 0.04), wp.vec3(0.24, 0.21, 0.10), crop[0])
        m.recess = -0.5 * fine * crop[1]
    elif coarse > 0.62:
        m.albedo = (0.8 + 0.2 * fine) * wp.vec3(0.32, 0.27, 0.2)
    return m


@wp.func
def roof(spot: Spot) -> Material:
    """Gravel, or rows of tiles."""
    m = Material()
    dice = random_of(2, 0, spot.seed)
    grain = smooth_noise(1.1 * spot.across, 1.1 * spot.up, spot.seed)
    if spot.kind == FLAT_ROOF:
        m.albedo = (0.24 + 0.2 * dice[0] + 0.08 * grain) * wp.vec3(1.0, 0.98, 0.95)
        return m
    tiles = wp.lerp(wp.vec3(0.36, 0.13, 0.07), wp.vec3(0.44, 0.22, 0.12), dice[1])
    if dice[0] < 0.3:
        tiles = wp.vec3(0.13, 0.14, 0.16) * (0.8 + 0.4 * dice[1])
    row = 1.6 * spot.up - wp.floor(1.6 * spot.up)
    m.albedo = tiles * (0.75 + 0.2 * grain + 0.25 * row)
    return m


@wp.func
def material_of(spot: Spot, half: wp.vec2) -> Material:
    if spot.kind == FACADE:
        return facade(spot)
    if spot.kind == CURTAIN_WALL:
        return curtain_wall(spot)
    if spot.kind == STREET:
        return street(spot, half)
    if spot.kind == FLAT_ROOF or spot.kind == TILED_ROOF:  # noqa: PLR1714 - Warp has no sets
        return roof(spot)
    return land(spot)
