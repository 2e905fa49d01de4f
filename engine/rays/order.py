# SPDX-License-Identifier: GPL-3.0-or-later
"""Which splats to draw, and in which order.

Splats that no ray of the window meets are left out (`support`), and what is left is sorted by its means' depth (RayGS,
Eq. 1). The radix sort is stable, so equal depths keep the order instance, splat.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt
import warp as wp

from ..device import launch
from ..device_cloud import DeviceCloud, read_splat
from ..device_look import dressed
from ..edit.state import NOT_SELECTABLE, SELECTED
from ..errors import StippleError
from ..maths.projection import DEPTH_KEY_BITS, Pose, View, depth_key, make_view
from ..settings import Settings
from ..splats import SplatCloud
from .support import Deformation, Frustum, make_deformation, make_frustum, may_be_met

if TYPE_CHECKING:
    from ..shot import Shot

wp.set_module_options({"enable_backward": False})

HIDDEN = wp.constant((1 << DEPTH_KEY_BITS) - 1)  # after every depth key
LEAST_ALPHA_MIN = 1e-6  # of p_min, which must not be 0: every support would be everywhere
MOST_PLACED = (1 << 30) - 1  # the radix sort counts twice as many in 32 bits


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


@wp.kernel
def find_keys_kernel(
    first: wp.int32,
    cloud: DeviceCloud,
    view: View,
    frustum: Frustum,
    pose: Pose,
    deformation: Deformation,
    offset: wp.int32,
    keys: wp.array(dtype=wp.int32),
    placements: wp.array(dtype=wp.int32),
) -> None:
    i = first + wp.tid()
    splat = dressed(read_splat(cloud, i), pose.look)
    p = pose.linear * splat.position + pose.translation
    key = int(HIDDEN)
    if may_be_met(view, frustum, pose, deformation, cloud, i, p, splat):
        key = int(depth_key(p[2], view))
    keys[offset + i] = key
    placements[offset + i] = offset + i


def least_opacity(settings: Settings) -> float:
    """p_min of the paper, below which a splat is not drawn."""
    return max(settings.alpha_min, LEAST_ALPHA_MIN)


def drawn_view(shot: Shot) -> View:
    """The view with the paper's p_min."""
    return make_view(shot.camera, replace(shot.settings, alpha_min=least_opacity(shot.settings)))


def order_key(shot: Shot) -> tuple[object, ...]:
    """Equal keys mean equal orders: all that `find_order` depends on. Holds the clouds, so no identity comes twice."""
    camera, settings = shot.camera, shot.settings
    placed = tuple(
        (i.cloud, i.states, np.asarray(i.world_from_object, np.float64).tobytes(), i.look.visibility)
        for i in shot.scene.instances
    )
    modulated = tuple(bool(pose.look.antialiased) for pose in shot.poses)
    lens = (camera.fx, camera.fy, camera.cx, camera.cy, camera.near, camera.far, camera.projection)
    cut = (least_opacity(settings), settings.dilation_px2, modulated, settings.point_scale)
    laid = (settings.ray_order, settings.storage)
    return placed, np.asarray(camera.camera_from_world).tobytes(), lens, camera.rendered_window, cut, laid


def first_places(splat_counts: Sequence[int]) -> npt.NDArray[np.int64]:
    """(I + 1,) where each instance's splats begin when all are counted through, and how many there are.

    Raises StippleError for more than can be sorted, before anything is allocated.
    """
    places = np.concatenate([[0], np.cumsum(splat_counts, dtype=np.int64)]).astype(np.int64)
    if places[-1] > MOST_PLACED:
        raise StippleError(
            f"rays: the scene's instances have {places[-1]:,} splats together and {MOST_PLACED:,} can be put in order; "
            "show fewer instances, or choose the points method."
        )
    return places


def find_order(shot: Shot, finest_px: float = 1.0) -> DrawOrder:
    """What the camera may see: farthest mean first, or in the scene's order for stochastic rays. Reads keys back.

    The order also serves cameras with the same view and finer pixels, down to `finest_px` times the size of this one's.
    Raises StippleError where the instances have too many splats together.
    """
    offsets, buffers = first_places([cloud.splat_count for cloud in shot.clouds]), shot.buffers
    total = int(offsets[-1])
    keys = buffers.array("rays_keys", wp.int32, 2 * total)  # the radix sort needs twice the room
    placements = buffers.array("rays_placements", wp.int32, 2 * total)
    view, frustum = drawn_view(shot), make_frustum(shot.camera, finest_px)
    placed = zip(shot.clouds, shot.poses, shot.scene.instances, offsets[:-1], strict=True)
    for cloud, pose, instance, offset in placed:
        deformation = make_deformation(shot.camera, np.asarray(instance.world_from_object, np.float64))
        inputs = [cloud, view, frustum, pose, deformation, int(offset), keys, placements]
        launch(find_keys_kernel, cloud.splat_count, inputs, buffers.device)
    if shot.settings.ray_order == "sorted":
        wp.utils.radix_sort_pairs(keys, placements, total, end_bit=DEPTH_KEY_BITS)
        drawn = placements.numpy()[: int(np.searchsorted(keys.numpy()[:total], int(HIDDEN)))][::-1]
    else:
        drawn = np.flatnonzero(keys.numpy()[:total] != int(HIDDEN))
    instances = np.searchsorted(offsets, drawn, side="right") - 1
    splats = (drawn - offsets[instances]).astype(np.int32)
    return DrawOrder(splats, instances.astype(np.int32), _highlighted(shot, splats, instances))


def _highlighted(shot: Shot, splat: npt.NDArray[np.int32], instance: npt.NDArray[np.intp]) -> npt.NDArray[np.bool_]:
    result = np.zeros(len(splat), bool)
    for k, (placed, cloud) in enumerate(zip(shot.scene.instances, shot.clouds, strict=True)):
        if placed.states is not None:
            here = instance == k
            # Of what stays in its file the host's words stand in another order than the splats on the device.
            words = placed.states.words if isinstance(placed.cloud, SplatCloud) else cloud.state.numpy()
            result[here] = (words[splat[here]] & (NOT_SELECTABLE | SELECTED)) == SELECTED
    return result
