# SPDX-License-Identifier: GPL-3.0-or-later
"""Which splats to draw, and in which order.

Whole quads are culled here, by their means' depth and by a sphere around their support; the shaders clip none (RayGS,
section 4.1, "A note on near plane clipping"). The radix sort is stable, so equal depths keep the order instance, splat.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt
import warp as wp

from ..camera import Camera
from ..device import launch
from ..device_cloud import DeviceCloud, read_splat
from ..device_look import dressed, opaque_from
from ..edit.state import NOT_SELECTABLE, SELECTED
from ..maths.projection import DEPTH_KEY_BITS, Pose, View, depth_key, make_view
from ..settings import Settings
from ..splats import SplatCloud

if TYPE_CHECKING:
    from ..shot import Shot

wp.set_module_options({"enable_backward": False})

HIDDEN = wp.constant((1 << DEPTH_KEY_BITS) - 1)  # after every depth key
LEAST_ALPHA_MIN = 1e-6  # of p_min, which must not be 0: every support would be everywhere


@dataclass(frozen=True, eq=False)
class DrawOrder:
    """What to draw, one after the other: `splat` of its cloud and `instance` of the scene, int32 (N,) each.

    `highlighted` (N,): selected in an edit.
    """

    splat: npt.NDArray[np.int32]
    instance: npt.NDArray[np.int32]
    highlighted: npt.NDArray[np.bool_]

    @property
    def count(self) -> int:
        return len(self.splat)


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
    prior = wp.where(opacity >= opaque_from, opacity, wp.min(opacity, 1.0))
    kappa = 2.0 * wp.log(prior / view.alpha_min)
    sigma = wp.max(scale) * wp.sqrt(wp.ddot(pose.linear, pose.linear))
    depth = wp.where(view.orthographic != 0, 1.0, p[2])
    pixel2 = pose.look.dilation_px2 / (view.focal_px[0] * view.focal_px[1]) * depth * depth
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
    splat = dressed(read_splat(cloud, i), pose.look)
    p = pose.linear * splat.position + pose.translation
    key = int(HIDDEN)
    if may_be_met(view, frustum, pose, p, splat.scale, splat.opacity):
        key = int(depth_key(p[2], view))
    keys[offset + i] = key
    placements[offset + i] = offset + i


def least_opacity(settings: Settings) -> float:
    """p_min of the paper, below which a splat is not drawn."""
    return max(settings.alpha_min, LEAST_ALPHA_MIN)


def order_key(shot: Shot) -> tuple[object, ...]:
    """Equal keys mean equal orders: all that `find_order` depends on. Holds the clouds, so no identity comes twice."""
    camera, settings = shot.camera, shot.settings
    placed = tuple(
        (i.cloud, i.states, np.asarray(i.world_from_object, np.float64).tobytes(), i.look.visibility)
        for i in shot.scene.instances
    )
    lens = (camera.fx, camera.fy, camera.cx, camera.cy, camera.near, camera.far, camera.projection)
    cut = (least_opacity(settings), settings.dilation_px2, settings.point_scale, settings.ray_order, settings.storage)
    return placed, np.asarray(camera.camera_from_world).tobytes(), lens, camera.rendered_window, cut


def find_order(shot: Shot) -> DrawOrder:
    """What the camera may see: farthest mean first, or in the scene's order for stochastic rays. Reads keys back."""
    offsets = np.concatenate([[0], np.cumsum([cloud.splat_count for cloud in shot.clouds], dtype=np.int64)])
    total, buffers = int(offsets[-1]), shot.buffers
    keys = buffers.array("rays_keys", wp.int32, 2 * total)  # the radix sort needs twice the room
    placements = buffers.array("rays_placements", wp.int32, 2 * total)
    view = make_view(shot.camera, replace(shot.settings, alpha_min=least_opacity(shot.settings)))
    frustum = make_frustum(shot.camera)
    for cloud, pose, offset in zip(shot.clouds, shot.poses, offsets[:-1], strict=True):
        inputs = [cloud, view, frustum, pose, int(offset), keys, placements]
        launch(find_keys_kernel, cloud.splat_count, inputs, buffers.device)
    if shot.settings.ray_order == "sorted":
        wp.utils.radix_sort_pairs(keys, placements, total, end_bit=DEPTH_KEY_BITS)
        drawn = placements.numpy()[: int(np.searchsorted(keys.numpy()[:total], int(HIDDEN)))][::-1]
    else:
        drawn = np.flatnonzero(keys.numpy()[:total] != int(HIDDEN))
    instance = np.searchsorted(offsets, drawn, side="right") - 1
    splat = (drawn - offsets[instance]).astype(np.int32)
    return DrawOrder(splat, instance.astype(np.int32), _highlighted(shot, splat, instance))


def _highlighted(shot: Shot, splat: npt.NDArray[np.int32], instance: npt.NDArray[np.intp]) -> npt.NDArray[np.bool_]:
    result = np.zeros(len(splat), bool)
    for k, (placed, cloud) in enumerate(zip(shot.scene.instances, shot.clouds, strict=True)):
        if placed.states is not None:
            here = instance == k
            # Of what stays in its file the host's words stand in another order than the splats on the device.
            words = placed.states.words if isinstance(placed.cloud, SplatCloud) else cloud.state.numpy()
            result[here] = (words[splat[here]] & (NOT_SELECTABLE | SELECTED)) == SELECTED
    return result
