# SPDX-License-Identifier: GPL-3.0-or-later
"""Splat number i of a generated city, in model space and without light: a leaf, or a flat piece of a surface."""

from __future__ import annotations

import warp as wp

from .city_materials import Spot, material_of, random_of, smooth_noise

wp.set_module_options({"enable_backward": False})

FINE, COARSE = wp.constant(0.52), wp.constant(0.9)  # standard deviation in units of a grid's spacing


@wp.struct
class City:
    """Surfaces in model space, one element each in the arrays; `first_patch` has one more."""

    surface_count: wp.int32
    kind: wp.array(dtype=wp.int32)
    seed: wp.array(dtype=wp.uint32)
    origin: wp.array(dtype=wp.vec3)
    across: wp.array(dtype=wp.vec3)
    up: wp.array(dtype=wp.vec3)
    rotation: wp.array(dtype=wp.quat)  # of x, y, z to across, up, outwards
    taper: wp.array(dtype=wp.float32)
    columns: wp.array(dtype=wp.int32)  # of patches
    rows: wp.array(dtype=wp.int32)
    first_patch: wp.array(dtype=wp.int32)
    heights: wp.array2d(dtype=wp.float32)
    highest: wp.float32
    half_size: wp.vec2
    fine: wp.vec2i  # columns and rows of splats in a patch
    coarse: wp.vec2i


@wp.struct
class Patch:
    """Which part of which surface: `corner` and `size` in units of its sides."""

    surface: wp.int32
    number: wp.int32
    corner: wp.vec2
    size: wp.vec2
    spacing: wp.vec2  # of fine splats [m]


@wp.struct
class Made:
    """A splat in model space; `normal` is what light falls on."""

    position: wp.vec3
    normal: wp.vec3
    scale: wp.vec3
    rotation: wp.quat
    opacity: wp.float32
    albedo: wp.vec3
    gloss: wp.float32


@wp.func
def to_object(p: wp.vec3) -> wp.vec3:
    return wp.vec3(p[0], -p[2], p[1])


@wp.func
def patch_of(city: City, number: wp.int32) -> Patch:
    low = int(0)
    high = city.surface_count
    while high - low > 1:
        middle = (low + high) / 2
        if city.first_patch[middle] <= number:
            low = middle
        else:
            high = middle
    patch = Patch()
    patch.surface = low
    patch.number = number - city.first_patch[low]
    columns, rows = float(city.columns[low]), float(city.rows[low])
    patch.size = wp.vec2(1.0 / columns, 1.0 / rows)
    column = patch.number / city.rows[low]
    row = patch.number - column * city.rows[low]
    patch.corner = wp.vec2(float(column) / columns, float(row) / rows)
    patch.spacing = wp.vec2(
        wp.length(city.across[low]) / (columns * float(city.fine[0])),
        wp.length(city.up[low]) / (rows * float(city.fine[1])),
    )
    return patch


@wp.func
def tree_spacing(city: City, patch: Patch, size: wp.int32) -> wp.float32:
    """Of the leaves of a tree [m]."""
    radius = wp.length(city.across[patch.surface])
    return radius * wp.sqrt(14.0 / float(city.rows[patch.surface] * size))


@wp.func
def make_leaf(city: City, patch: Patch, local: wp.int32, size: wp.int32) -> Made:
    """Splats of a wedge of a crown; the first wedge has the trunk as well."""
    made = Made()
    surface = patch.surface
    seed = city.seed[surface]
    dice = random_of(local, patch.number, seed)
    more = random_of(local, patch.number, seed + wp.uint32(1))
    foot = city.origin[surface]
    radius, height = wp.length(city.across[surface]), city.up[surface][2]
    spacing = tree_spacing(city, patch, size)
    made.opacity = 0.35 + 0.6 * dice[2]
    if patch.number == 0 and local < size / 16:
        angle = 6.2831853 * dice[0]
        made.normal = wp.vec3(wp.cos(angle), wp.sin(angle), 0.0)
        made.position = foot + 0.16 * made.normal + wp.vec3(0.0, 0.0, 0.45 * height * dice[1])
        made.scale = wp.vec3(0.07, 0.07, 0.35)
        made.rotation = wp.quat(0.0, 0.0, 0.0, 1.0)
        made.albedo = wp.vec3(0.10, 0.075, 0.05)
        made.opacity = 0.95
        return made
    angle = 6.2831853 * (float(patch.number) + dice[0]) / float(city.rows[surface])
    z = 2.0 * dice[1] - 1.0
    flat = wp.sqrt(wp.max(0.0, 1.0 - z * z))
    made.normal = wp.vec3(flat * wp.cos(angle), flat * wp.sin(angle), z)
    clump = smooth_noise(2.2 * angle, 2.5 * z, seed)
    out = (0.62 + 0.42 * clump) * (0.72 + 0.3 * wp.sqrt(more[0]))
    extent = wp.cw_mul(wp.vec3(radius, radius, 0.36 * height), made.normal)
    made.position = foot + wp.vec3(0.0, 0.0, 0.62 * height) + out * extent
    long = spacing * (0.7 + 0.7 * more[1])
    made.scale = wp.vec3(long, 0.65 * long, 0.3 * long)
    made.rotation = wp.normalize(
        wp.quat(2.0 * dice[0] - 1.0, 2.0 * more[1] - 1.0, 2.0 * more[2] - 1.0, 2.0 * dice[2] - 1.0)
    )
    green = wp.lerp(wp.vec3(0.06, 0.12, 0.025), wp.vec3(0.15, 0.22, 0.05), random_of(0, 1, seed)[0])
    made.albedo = green * (0.45 + 0.75 * clump + 0.3 * more[2])
    return made


@wp.func
def make_surfel(city: City, patch: Patch, local: wp.int32, number: wp.int32) -> Made:
    """A splat of a patch's fine or coarse grid, flat on the surface."""
    made = Made()
    surface = patch.surface
    fine_count = city.fine[0] * city.fine[1]
    is_fine = local < fine_count
    grid = wp.where(is_fine, city.fine, city.coarse)
    cell = wp.where(is_fine, local, local - fine_count)
    extent = wp.where(is_fine, FINE, COARSE)
    row = cell / grid[0]
    column = cell - row * grid[0]
    dice = random_of(number, 0, wp.uint32(17))
    more = random_of(number, 1, wp.uint32(17))
    u = patch.corner[0] + patch.size[0] * (float(column) + 0.5 + 0.5 * (dice[0] - 0.5)) / float(grid[0])
    v = patch.corner[1] + patch.size[1] * (float(row) + 0.5 + 0.5 * (dice[1] - 0.5)) / float(grid[1])
    if not is_fine:  # which must not stand out beyond the edges
        inset_u, inset_v = 0.8 * extent * patch.size[0] / float(grid[0]), 0.8 * extent * patch.size[1] / float(grid[1])
        u, v = wp.clamp(u, inset_u, 1.0 - inset_u), wp.clamp(v, inset_v, 1.0 - inset_v)
    narrow = wp.max(1.0 - city.taper[surface] * v, 0.02)
    across, up = city.across[surface], city.up[surface]
    made.normal = wp.normalize(wp.cross(across, up))
    spot = Spot()
    spot.kind = city.kind[surface]
    spot.seed = city.seed[surface]
    spot.width = wp.length(across)
    spot.height = wp.length(up)
    u = 0.5 + (u - 0.5) * narrow
    spot.across = u * spot.width
    spot.up = v * spot.height
    spot.position = city.origin[surface] + u * across + v * up
    material = material_of(spot, city.half_size)
    made.position = spot.position - (material.recess + wp.where(is_fine, 0.0, 0.04)) * made.normal
    size_u = narrow * patch.spacing[0] * float(city.fine[0]) / float(grid[0])
    size_v = patch.spacing[1] * float(city.fine[1]) / float(grid[1])
    vary = 0.85 + 0.35 * dice[2]
    made.scale = extent * wp.vec3(size_u * vary, size_v * (2.05 - vary), 0.12 * wp.min(size_u, size_v))
    tilt = wp.quat(0.08 * (more[0] - 0.5), 0.08 * (more[1] - 0.5), 0.35 * (more[2] - 0.5), 1.0)
    made.rotation = city.rotation[surface] * wp.normalize(tilt)
    made.opacity = 1.0 - 0.04 * more[0]
    if is_fine:  # as in trained captures: many half transparent
        made.opacity = 0.97 - 0.65 * more[0] * more[0]
    made.albedo = material.albedo
    made.gloss = material.gloss
    return made
