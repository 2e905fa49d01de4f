# SPDX-License-Identifier: GPL-3.0-or-later
"""What one ray meets, splat by splat, by Eq. 2, 5 and 16 of RayGS: as the fragments of a pixel's centre, undrawn."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt
import warp as wp

from ..camera import Camera
from ..device import launch
from ..device_cloud import DeviceCloud, read_rotation, read_splat
from ..device_look import dressed, dressed_opacity, opaque_from
from ..groups import group_reach
from ..maths.projection import Pose, View
from .order import drawn_view
from .raygs import D_ray, omega, on_quad, quad_of, tau_on_quad
from .support import Deformation, Frustum, make_deformation, make_frustum, may_be_met, primitive_of

if TYPE_CHECKING:
    from ..shot import Shot

wp.set_module_options({"enable_backward": False})

IntArray, FloatArray = npt.NDArray[np.int32], npt.NDArray[np.float64]


@wp.struct
class Ray:
    """origin + λ x in camera space; z of x is 1, so that λ is the depth."""

    origin: wp.vec3
    x: wp.vec3


def make_ray(camera: Camera, x_px: float, y_px: float) -> Ray:
    """Through a point of the frame [px]."""
    slope = wp.vec3((x_px - camera.cx) / camera.fx, (y_px - camera.cy) / camera.fy, 0.0)
    ray, forward = Ray(), wp.vec3(0.0, 0.0, 1.0)
    ray.origin, ray.x = (slope, forward) if camera.projection == "orthographic" else (wp.vec3(), slope + forward)
    return ray


@wp.kernel
def find_groups_kernel(
    first: wp.int32,
    cloud: DeviceCloud,
    view: View,
    pose: Pose,
    deformation: Deformation,
    ray: Ray,
    met: wp.array(dtype=wp.int32),
) -> None:
    """1 for groups whose splats the ray may meet: some mean is nearer to it than √κ standard deviations."""
    group = first + wp.tid()
    met[group] = 0
    groups = cloud.groups
    opacity = dressed_opacity(groups.opacity[group], pose.look)
    if not opacity > view.alpha_min:
        return
    middle = pose.linear * (0.5 * (groups.low[group] + groups.high[group])) + pose.translation
    half = 0.5 * wp.length(groups.high[group] - groups.low[group]) * deformation.stretch
    farthest = middle[2] + half
    if farthest <= view.near:
        return
    pixel = wp.sqrt(pose.look.dilation_px2 / (view.focal_px[0] * view.focal_px[1]))
    if view.orthographic == 0:
        pixel *= farthest
    sigma = pose.look.size * wp.length(groups.sigma[group]) * deformation.stretch
    reach = 1.01 * (half + group_reach(opacity, view.alpha_min) * (sigma + pixel))
    distance = wp.length(wp.cross(middle - ray.origin, ray.x)) / wp.length(ray.x)
    if not distance > reach:  # a NaN is looked at
        met[group] = 1


@wp.kernel
def meet_kernel(
    first: wp.int32,
    blocks: wp.array(dtype=wp.int32),  # groups
    cloud: DeviceCloud,
    view: View,
    frustum: Frustum,
    pose: Pose,
    deformation: Deformation,
    ray: Ray,
    met: wp.array(dtype=wp.vec3),
) -> None:
    """Opacity, depth of greatest density and depth of the mean of every splat; opacity 0 of what the ray misses."""
    thread = first + wp.tid()
    met[thread] = wp.vec3()
    shift = cloud.groups.shift
    i = (blocks[thread >> shift] << shift) + (thread & ((1 << shift) - 1))
    if i >= cloud.splat_count:
        return
    splat = dressed(read_splat(cloud, i), pose.look)
    p = pose.linear * splat.position + pose.translation
    if not may_be_met(view, frustum, pose, deformation, cloud, i, p, splat):
        return
    parallel = view.orthographic != 0
    modulate = pose.look.antialiased != 0
    a = primitive_of(view, pose, p, splat, read_rotation(cloud, i))
    quad = quad_of(a.x, a.M, deformation.sweeps, a.o, a.filter_variance, view.alpha_min, modulate, parallel)
    if not quad.visible:
        return
    z = on_quad(quad, a.mu, ray.origin / a.unit, ray.x)
    z2 = z[0] * z[0] + z[1] * z[1]
    opacity = omega(quad.o, D_ray(z2, quad.inverse_c2))
    # Outside the support (Eq. 3) a NaN is too. Eq. 5 is even in x: only what is in front of the camera counts.
    if opacity >= view.alpha_min and (parallel or z[2] > 0.0):
        opacity = wp.min(opacity, wp.where(quad.o < opaque_from, view.alpha_max, 1.0))
        met[thread] = wp.vec3(opacity, z[2] * a.unit * tau_on_quad(z2, quad.inverse_c2), p[2])


def meet_ray(shot: Shot, x_px: float, y_px: float) -> tuple[IntArray, IntArray, FloatArray, FloatArray]:
    """(splat, instance, opacity, depth) of what the ray through a point of the frame [px] meets, front to back.

    In front is what has the nearer mean (Eq. 1), with stochastic order what the ray meets first. Depth is that of
    greatest density (Prop. A.1), along z [world units], as in pictures. The point lies in the camera's window, which
    had better be small. Reads the groups back that the ray may meet, and their splats.
    """
    view, frustum, ray = drawn_view(shot), make_frustum(shot.camera), make_ray(shot.camera, x_px, y_px)
    device = shot.buffers.device
    found: list[npt.NDArray[np.float64]] = []
    for k, (cloud, pose, placed) in enumerate(zip(shot.clouds, shot.poses, shot.scene.instances, strict=True)):
        deformation = make_deformation(shot.camera, np.asarray(placed.world_from_object, np.float64))
        near_ray = wp.empty(cloud.groups.count, dtype=wp.int32, device=device)
        launch(find_groups_kernel, near_ray.size, [cloud, view, pose, deformation, ray, near_ray], device)
        groups = np.flatnonzero(near_ray.numpy()).astype(np.int32)
        met = wp.empty(len(groups) << cloud.groups.shift, dtype=wp.vec3, device=device)
        blocks = wp.array(groups, dtype=wp.int32, device=device)
        launch(meet_kernel, met.size, [blocks, cloud, view, frustum, pose, deformation, ray, met], device)
        rows = met.numpy().reshape(-1, 3)
        hit = np.flatnonzero(rows[:, 0])
        splat = (groups[hit >> cloud.groups.shift] << cloud.groups.shift) + (hit & ((1 << cloud.groups.shift) - 1))
        found.append(np.column_stack([splat, np.full(len(hit), k), rows[hit]]))
    splat, instance, opacity, depth, mean = np.concatenate([np.zeros((0, 5)), *found]).T
    order = np.argsort(depth if shot.settings.ray_order == "stochastic" else mean, kind="stable")
    return splat.astype(np.int32)[order], instance.astype(np.int32)[order], opacity[order], depth[order]
