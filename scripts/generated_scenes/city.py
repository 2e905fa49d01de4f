# SPDX-License-Identifier: GPL-3.0-or-later
"""A city of any number of splats that makes itself on the device, quantised and in order: no file, no sort.

Every splat is a function of its number. Consecutive numbers fill a patch of a surface (`city_patches`), consecutive
patches a surface, consecutive surfaces a house and a block (`city_plan`): neighbours along the order are neighbours in
space, and each group is one patch. Object space is x east, y down, z north [m].
"""

from __future__ import annotations

from functools import cached_property

import numpy as np
import numpy.typing as npt
import warp as wp

from stipple.engine.cloud_upload import Progress
from stipple.engine.device import launch
from stipple.engine.device_cloud import DeviceCloud, empty_cloud
from stipple.engine.group_bounds import bound_groups
from stipple.engine.maths.packing import pack_colour, pack_geometry
from stipple.engine.splats import packed_bytes_per_splat

from .city_light import SKY_COLOUR, SUN, SUN_COLOUR, encoded, openness, sunlight
from .city_materials import TREE, random_of
from .city_patches import Grid, blocks_per_side, cut_into_patches
from .city_plan import FIELDS_BESIDE, plan_city
from .city_splats import City, Made, make_leaf, make_surfel, patch_of, to_object, tree_spacing

wp.set_module_options({"enable_backward": False})

SPLATS_PER_LAUNCH = 1 << 21
GROUP_BYTES = 76  # bounds and packing ranges
RELIEF = wp.constant(0.7)  # how far splats lie from the plane of their surface at most [m]
OBJECT_FROM_MODEL = wp.constant(wp.quat(0.70710678, 0.0, 0.0, 0.70710678))  # z up to y down


@wp.func
def lit(city: City, made: Made, number: wp.int32) -> wp.vec3:
    """sRGB-encoded colour of a splat in sun and sky."""
    light = float(0.0)
    cosine = wp.dot(made.normal, SUN)
    if cosine > 0.0:
        start = made.position + 0.4 * made.normal
        light = cosine * sunlight(
            city.heights, city.half_size, city.highest, start, random_of(number, 2, wp.uint32(17))[0]
        )
    sky = openness(city.heights, city.half_size, made.position, made.normal)
    colour = wp.cw_mul(made.albedo, light * SUN_COLOUR + sky * SKY_COLOUR)
    mirrored = wp.lerp(
        wp.vec3(0.25, 0.24, 0.22), wp.vec3(0.55, 0.68, 0.86), wp.clamp(0.03 * made.position[2], 0.0, 1.0)
    )
    return encoded(colour + made.gloss * sky * mirrored)


@wp.kernel
def find_ranges_kernel(first: wp.int32, city: City, cloud: DeviceCloud) -> None:
    """What the packed values of each group are relative to, from its patch's corners."""
    group = first + wp.tid()
    patch = patch_of(city, group)
    surface = patch.surface
    origin, across, up = city.origin[surface], city.across[surface], city.up[surface]
    low = origin + patch.corner[0] * across + patch.corner[1] * up
    high = low + patch.size[0] * across + patch.size[1] * up
    bottom, top = wp.min(low, high), wp.max(low, high)
    if city.taper[surface] > 0.0:  # narrowed towards the middle of the surface
        middle = origin + 0.5 * across + patch.corner[1] * up
        bottom, top = wp.min(bottom, middle), wp.max(top, middle)
    least, most = wp.min(patch.spacing), wp.max(patch.spacing)
    margin = RELIEF * wp.abs(wp.normalize(wp.cross(across, up)))
    if city.kind[surface] == TREE:
        radius = wp.length(across)
        bottom, top = origin - wp.vec3(radius, radius, 0.0), origin + wp.vec3(radius, radius, up[2])
        margin = wp.vec3(0.1, 0.1, 0.1)
        least = wp.min(0.07, tree_spacing(city, patch, 1 << cloud.groups.shift))
        most = wp.max(0.35, tree_spacing(city, patch, 1 << cloud.groups.shift))
    bottom, top = to_object(bottom - margin), to_object(top + margin)
    cloud.groups.packed_low[group] = wp.min(bottom, top)
    cloud.groups.packed_span[group] = wp.max(bottom, top) - wp.min(bottom, top)
    smallest = wp.log(0.02 * wp.max(least, 0.01))
    cloud.groups.packed_log_scale[group] = wp.vec2(smallest, wp.log(4.0 * most) - smallest)
    cloud.groups.packed_brightest[group] = 1.0


@wp.kernel
def make_splats_kernel(first: wp.int32, begin: wp.int32, city: City, cloud: DeviceCloud) -> None:
    i = begin + first + wp.tid()
    group = i >> cloud.groups.shift
    size = 1 << cloud.groups.shift
    local = i & (size - 1)
    patch = patch_of(city, group)
    made = Made()
    if city.kind[patch.surface] == TREE:
        made = make_leaf(city, patch, local, size)
    else:
        made = make_surfel(city, patch, local, i)
    q = OBJECT_FROM_MODEL * made.rotation
    cloud.packed_geometry[i] = pack_geometry(
        to_object(made.position),
        made.scale,
        wp.vec4(q[3], q[0], q[1], q[2]),
        cloud.groups.packed_low[group],
        cloud.groups.packed_span[group],
        cloud.groups.packed_log_scale[group],
    )
    cloud.packed_opacity[i] = wp.uint8(made.opacity * 255.0 + 0.5)
    cloud.packed_colour[i] = pack_colour(lit(city, made, i), 1.0)


class GeneratedCity:
    """A city of `splat_count` splats without harmonics, a `DeviceSource`."""

    sh_degree = 0

    def __init__(self, splat_count: int, seed: int = 4) -> None:
        self.splat_count, self.seed = splat_count, seed
        self.name = f"city of {splat_count:,} splats"
        self._plan = plan_city(blocks_per_side(splat_count), seed)
        self._patches = cut_into_patches(self._plan, splat_count)

    @property
    def nbytes(self) -> int:
        return self.splat_count * packed_bytes_per_splat(0) + self._patches.count * GROUP_BYTES

    @property
    def half_size(self) -> npt.NDArray[np.float64]:
        """Of the built-up part along x and z [m]."""
        return self._plan.half_size

    @cached_property
    def bounds(self) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
        """Corners of a box around all means, not the smallest one."""
        x, z = self._plan.half_size + FIELDS_BESIDE
        top = 1.0 + max(surface.origin[2] + surface.up[2] for surface in self._plan.surfaces)
        return np.array([-x, -top, -z]), np.array([x, 1.5, z])

    def upload(self, device: wp.Device, progress: Progress) -> DeviceCloud:
        """Made anew each time, the same bits on one device."""
        cloud = empty_cloud(self.splat_count, 0)
        cloud.is_quantised = 1
        groups = cloud.groups
        groups.shift, groups.count = self._patches.shift, self._patches.count
        groups.packed_low = wp.empty(groups.count, dtype=wp.vec3, device=device)
        groups.packed_span = wp.empty(groups.count, dtype=wp.vec3, device=device)
        groups.packed_log_scale = wp.empty(groups.count, dtype=wp.vec2, device=device)
        groups.packed_brightest = wp.empty(groups.count, dtype=wp.float32, device=device)
        cloud.groups = groups
        cloud.packed_geometry = wp.empty(self.splat_count, dtype=wp.vec4ui, device=device)
        cloud.packed_opacity = wp.empty(self.splat_count, dtype=wp.uint8, device=device)
        cloud.packed_colour = wp.empty(self.splat_count, dtype=wp.uint32, device=device)
        city = self._city(device)
        launch(find_ranges_kernel, groups.count, [city, cloud], device)
        for begin in range(0, self.splat_count, SPLATS_PER_LAUNCH):
            progress(begin / self.splat_count, f"building {self.name}")
            count = min(SPLATS_PER_LAUNCH, self.splat_count - begin)
            launch(make_splats_kernel, count, [begin, city, cloud], device)
        bound_groups(cloud, device)
        return cloud

    def _city(self, device: wp.Device) -> City:
        surfaces, patches = self._plan.surfaces, self._patches
        across, up = (np.array([getattr(s, side) for s in surfaces]) for side in ("across", "up"))
        grid = Grid.of_shift(patches.shift)
        city = City()
        city.surface_count = len(surfaces)
        city.kind = wp.array([s.kind for s in surfaces], dtype=wp.int32, device=device)
        city.seed = wp.array([s.seed for s in surfaces], dtype=wp.uint32, device=device)
        city.origin = wp.array([s.origin for s in surfaces], dtype=wp.vec3, device=device)
        city.across = wp.array(across, dtype=wp.vec3, device=device)
        city.up = wp.array(up, dtype=wp.vec3, device=device)
        city.rotation = wp.array(_quaternions(across, up), dtype=wp.quat, device=device)
        city.taper = wp.array([s.taper for s in surfaces], dtype=wp.float32, device=device)
        city.columns = wp.array(patches.columns, dtype=wp.int32, device=device)
        city.rows = wp.array(patches.rows, dtype=wp.int32, device=device)
        city.first_patch = wp.array(patches.first, dtype=wp.int32, device=device)
        city.heights = wp.array(self._plan.heights, dtype=wp.float32, device=device)
        city.highest = float(self._plan.heights.max())
        city.half_size = wp.vec2(*self._plan.half_size)
        city.fine, city.coarse = wp.vec2i(*grid.fine), wp.vec2i(*grid.coarse)
        return city


def _quaternions(across: npt.NDArray[np.float64], up: npt.NDArray[np.float64]) -> npt.NDArray[np.float32]:
    """(N, 4) x, y, z, w of the rotations that take x, y and z to across, up and their cross product."""
    x, y = (side / np.linalg.norm(side, axis=1, keepdims=True) for side in (across, up))
    axes = np.stack([x, y, np.cross(x, y)], axis=2)
    return np.array([wp.quat_from_matrix(wp.mat33(*matrix.ravel())) for matrix in axes], np.float32)
