# SPDX-License-Identifier: GPL-3.0-or-later
"""Which splats to draw, and in which order.

Whole quads are culled here, by their means' depth and by a sphere around their support; the shaders clip none (RayGS,
section 4.1, "A note on near plane clipping"). The radix sort is stable, so equal depths keep the order instance, splat.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import warp as wp

from ..buffers import Buffers
from ..camera import Camera
from ..device import launch
from ..device_cloud import DeviceCloud, read_splat
from ..maths.projection import DEPTH_KEY_BITS, Pose, View, depth_key

wp.set_module_options({"enable_backward": False})

HIDDEN = wp.constant((1 << DEPTH_KEY_BITS) - 1)  # after every depth key


@wp.struct
class Frustum:
    """Planes n · p + d >= 0 in camera space, |n| = 1, through the window's left, right, top and bottom edge."""

    left: wp.vec4
    right: wp.vec4
    top: wp.vec4
    bottom: wp.vec4


def make_frustum(camera: Camera) -> Frustum:
    x, y, width, height = camera.rendered_window
    orthographic = camera.projection == "orthographic"
    edges = (
        (0, 1.0, (x - camera.cx) / camera.fx),
        (0, -1.0, (x + width - camera.cx) / camera.fx),
        (1, 1.0, (y - camera.cy) / camera.fy),
        (1, -1.0, (y + height - camera.cy) / camera.fy),
    )
    planes = []
    for axis, sign, slope in edges:
        plane = np.zeros(4)
        plane[axis] = sign
        plane[3 if orthographic else 2] = -sign * slope
        planes.append(wp.vec4(*(plane / np.linalg.norm(plane[:3]))))
    frustum = Frustum()
    frustum.left, frustum.right, frustum.top, frustum.bottom = planes
    return frustum


@wp.func
def beyond(plane: wp.vec4, p: wp.vec3) -> wp.float32:
    return plane[0] * p[0] + plane[1] * p[1] + plane[2] * p[2] + plane[3]


@wp.func
def may_be_met(view: View, frustum: Frustum, pose: Pose, p: wp.vec3, scale: wp.vec3, opacity: wp.float32) -> wp.bool:
    """False only for splats whose support no ray of the window meets.

    A ray of the support passes within √κ standard deviations of the mean (§3), so within that sphere; κ is taken
    before Eq. 17 lowers it. NaN fails every comparison and is never seen.
    """
    if not (p[2] > view.near and p[2] < view.far and opacity > view.alpha_min):
        return False
    kappa = 2.0 * wp.log(wp.min(opacity, 1.0) / view.alpha_min)
    sigma = wp.max(scale) * wp.sqrt(wp.ddot(pose.linear, pose.linear))
    depth = wp.where(view.orthographic != 0, 1.0, p[2])
    pixel2 = view.dilation_px2 / (view.focal_px[0] * view.focal_px[1]) * depth * depth
    radius = wp.sqrt(kappa) * (sigma + wp.sqrt(pixel2)) * 1.001
    inside = wp.min(
        wp.min(beyond(frustum.left, p), beyond(frustum.right, p)),
        wp.min(beyond(frustum.top, p), beyond(frustum.bottom, p)),
    )
    return inside > -radius


@wp.kernel
def find_keys_kernel(
    first: wp.int32,
    cloud: DeviceCloud,
    view: View,
    frustum: Frustum,
    pose: Pose,
    offset: wp.int32,
    keys: wp.array(dtype=wp.int32),
    placements: wp.array(dtype=wp.int32),
) -> None:
    i = first + wp.tid()
    splat = read_splat(cloud, i)
    p = pose.linear * splat.position + pose.translation
    key = int(HIDDEN)
    if may_be_met(view, frustum, pose, p, splat.scale, splat.opacity):
        key = int(depth_key(p[2], view))
    keys[offset + i] = key
    placements[offset + i] = offset + i


def find_order(
    clouds: list[DeviceCloud], poses: list[Pose], view: View, camera: Camera, by_depth: bool, buffers: Buffers
) -> tuple[npt.NDArray[np.int32], npt.NDArray[np.int32]]:
    """(splat, instance) of what to draw, farthest mean first, or in the scene's order unless `by_depth`.

    `clouds` and `poses` run in parallel, one pair per instance.
    """
    offsets = np.concatenate([[0], np.cumsum([cloud.splat_count for cloud in clouds], dtype=np.int64)])
    total = int(offsets[-1])
    keys = buffers.array("rays_keys", wp.int32, 2 * total)  # the radix sort needs twice the room
    placements = buffers.array("rays_placements", wp.int32, 2 * total)
    frustum = make_frustum(camera)
    for cloud, pose, offset in zip(clouds, poses, offsets[:-1], strict=True):
        inputs = [cloud, view, frustum, pose, int(offset), keys, placements]
        launch(find_keys_kernel, cloud.splat_count, inputs, buffers.device)
    if by_depth:
        wp.utils.radix_sort_pairs(keys, placements, total, end_bit=DEPTH_KEY_BITS)
        drawn = placements.numpy()[: int(np.searchsorted(keys.numpy()[:total], int(HIDDEN)))][::-1]
    else:
        drawn = np.flatnonzero(keys.numpy()[:total] != int(HIDDEN))
    instance = np.searchsorted(offsets, drawn, side="right") - 1
    return (drawn - offsets[instance]).astype(np.int32), instance.astype(np.int32)
