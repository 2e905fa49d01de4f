# SPDX-License-Identifier: GPL-3.0-or-later
"""Find splats by where a camera sees them: under a circle, a box or a lasso, or in a range of depths.

Pixels count from the top left of the camera's whole frame. Splats outside the clipping range match nothing; occluded
ones match like others (`match_visible` tells which are seen: combine both with `&`). Each function takes the object's
`look`: what it crops away or does not display matches nothing, and a splat's border is where it is drawn.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import warp as wp

from ..camera import Camera
from ..device import launch
from ..device_cloud import Splat
from ..device_look import DeviceLook, dressed, make_device_look
from ..errors import StippleError
from ..look import Look
from ..maths.projection import Pose, View, make_pose, make_view, project_splat
from ..settings import Settings
from .affine import checked
from .editable_cloud import ELEMENTS, EditableCloud
from .mask import Mask, mask_from_hits

wp.set_module_options({"enable_backward": False})

PLAIN = Look()


@wp.func
def in_range(view: View, p: wp.vec3) -> wp.bool:
    return p[2] > view.near and p[2] < view.far


@wp.func
def pixel_of(view: View, p: wp.vec3) -> wp.vec2:
    """Where a point of camera space, within the clipping range, is seen [px]."""
    inverse_z = wp.where(view.orthographic == 0, 1.0 / p[2], 1.0)
    return wp.cw_mul(view.focal_px, wp.vec2(p[0], p[1])) * inverse_z + view.centre_px


@wp.func
def shown_splat(
    i: wp.int32,
    look: DeviceLook,
    position: wp.array(dtype=wp.vec3),
    scale: wp.array(dtype=wp.vec3),
    opacity: wp.array(dtype=wp.float32),
) -> Splat:
    """Splat i as the look shows it, one that it does not show with an opacity below 0.

    Without its scales it is a point, and without its opacity opaque.
    """
    splat = Splat()
    splat.position = position[i]
    splat.opacity = 1.0
    if scale.shape[0] > 0:
        splat.scale = scale[i]
    if opacity.shape[0] > 0:
        splat.opacity = opacity[i]
    return dressed(splat, look)


@wp.func
def circle_meets_ellipse(
    offset: wp.vec2, radius: wp.float32, xx: wp.float32, xy: wp.float32, yy: wp.float32, reach: wp.float32
) -> wp.bool:
    """Splatshop's test (§3.1.2, figure 13): is the circle's centre in the ellipse whose half-axes grew by its radius?

    `offset` from the ellipse's centre; the ellipse is `reach` standard deviations of the covariance [px²].
    """
    middle = 0.5 * (xx + yy)
    spread = wp.sqrt(0.25 * (xx - yy) * (xx - yy) + xy * xy)
    # The long axis turns by half the angle of the vector (xx - yy, 2 xy).
    angle = 0.5 * wp.atan2(2.0 * xy, xx - yy)
    along = wp.vec2(wp.cos(angle), wp.sin(angle))
    u = wp.dot(along, offset) / (reach * wp.sqrt(middle + spread) + radius)
    v = (along[0] * offset[1] - along[1] * offset[0]) / (reach * wp.sqrt(wp.max(middle - spread, 0.0)) + radius)
    return u * u + v * v < 1.0


@wp.kernel
def match_circle_kernel(
    first: wp.int32,
    position: wp.array(dtype=wp.vec3),
    scale: wp.array(dtype=wp.vec3),
    rotation: wp.array(dtype=wp.vec4),
    opacity: wp.array(dtype=wp.float32),
    view: View,
    pose: Pose,
    centre: wp.vec2,
    radius: wp.float32,
    border: wp.int32,
    hits: wp.array(dtype=wp.uint8),
) -> None:
    i = first + wp.tid()
    splat = shown_splat(i, pose.look, position, scale, opacity)
    p = pose.linear * splat.position + pose.translation
    hit = int(0)
    if splat.opacity >= 0.0 and in_range(view, p):
        offset = centre - pixel_of(view, p)
        if wp.length_sq(offset) <= radius * radius:
            hit = 1
        elif border != 0:
            alpha = splat.opacity
            if alpha > view.alpha_min:
                e = project_splat(view, pose, p, splat.scale, rotation[i], alpha)
                reach = wp.sqrt(2.0 * wp.log(alpha / view.alpha_min))
                if circle_meets_ellipse(offset, radius, e.xx, e.xy, e.yy, reach):
                    hit = 1
    hits[i] = wp.uint8(hit)


@wp.kernel
def match_box_kernel(
    first: wp.int32,
    position: wp.array(dtype=wp.vec3),
    scale: wp.array(dtype=wp.vec3),
    opacity: wp.array(dtype=wp.float32),
    view: View,
    pose: Pose,
    low: wp.vec2,
    high: wp.vec2,
    depths: wp.vec2,
    hits: wp.array(dtype=wp.uint8),
) -> None:
    i = first + wp.tid()
    splat = shown_splat(i, pose.look, position, scale, opacity)
    p = pose.linear * splat.position + pose.translation
    hit = int(0)
    if splat.opacity >= 0.0 and in_range(view, p) and p[2] >= depths[0] and p[2] <= depths[1]:
        px = pixel_of(view, p)
        if px[0] >= low[0] and px[1] >= low[1] and px[0] <= high[0] and px[1] <= high[1]:
            hit = 1
    hits[i] = wp.uint8(hit)


@wp.kernel
def match_polygon_kernel(
    first: wp.int32,
    position: wp.array(dtype=wp.vec3),
    scale: wp.array(dtype=wp.vec3),
    opacity: wp.array(dtype=wp.float32),
    view: View,
    pose: Pose,
    edges: wp.array(dtype=wp.vec4),  # x, y of both ends, row by row of pixels
    first_edge: wp.array(dtype=wp.int32),  # of each row; one more than there are rows
    first_row: wp.int32,
    hits: wp.array(dtype=wp.uint8),
) -> None:
    i = first + wp.tid()
    splat = shown_splat(i, pose.look, position, scale, opacity)
    p = pose.linear * splat.position + pose.translation
    crossings = int(0)
    if splat.opacity >= 0.0 and in_range(view, p):
        px = pixel_of(view, p)
        row = int(wp.clamp(wp.floor(px[1]), -1.0e9, 1.0e9)) - first_row
        if row >= 0 and row < first_edge.shape[0] - 1:
            for j in range(first_edge[row], first_edge[row + 1]):
                e = edges[j]
                spans = (e[1] > px[1]) != (e[3] > px[1])
                if spans and px[0] < e[0] + (px[1] - e[1]) * (e[2] - e[0]) / (e[3] - e[1]):
                    crossings += 1
    hits[i] = wp.uint8(crossings & 1)


def match_circle(
    cloud: EditableCloud,
    camera: Camera,
    centre_px: npt.ArrayLike,
    radius_px: float,
    border: bool = False,
    world_from_object: npt.ArrayLike | None = None,
    look: Look = PLAIN,
) -> Mask:
    """Splats whose mean, or with `border` whose drawn ellipse, a circle on the screen touches [px].

    The ellipse ends where the splat is no longer drawn (opacity 1/255), and the test is the paper's enlarged ellipse:
    it may miss a circle that only grazes the side of a sharp end. Raises StippleError for a radius not above 0.
    """
    centre = np.asarray(centre_px, np.float64)
    if not (np.isfinite(centre).all() and np.isfinite(radius_px) and radius_px > 0):
        raise StippleError(f"selection circle: radius {radius_px} px at {centre}; give finite values above 0.")
    view, pose = _seen(camera, world_from_object, look)
    position, scale, opacity = _shown_arrays(cloud, look, border)
    rotation = _array_if(border, cloud, "rotation")
    hits = cloud.hits()
    inputs = [position, scale, rotation, opacity, view, pose, wp.vec2(*centre), radius_px, int(border), hits]
    launch(match_circle_kernel, cloud.splat_count, inputs, cloud.device)
    return mask_from_hits(hits, cloud.splat_count)


def match_rectangle(
    cloud: EditableCloud,
    camera: Camera,
    low_px: npt.ArrayLike,
    high_px: npt.ArrayLike,
    world_from_object: npt.ArrayLike | None = None,
    look: Look = PLAIN,
) -> Mask:
    """Splats whose mean is seen between two corners, in any order [px]."""
    corners = np.array([low_px, high_px], np.float64)
    return _match_rectangle(
        cloud, camera, corners.min(axis=0), corners.max(axis=0), (-np.inf, np.inf), world_from_object, look
    )


def match_depth(
    cloud: EditableCloud,
    camera: Camera,
    nearest: float,
    farthest: float,
    world_from_object: npt.ArrayLike | None = None,
    look: Look = PLAIN,
) -> Mask:
    """Splats whose mean is between two distances along the view direction [world units], seen in the frame or not.

    Raises StippleError where `nearest` is above `farthest`.
    """
    if not nearest <= farthest:
        raise StippleError(f"depth range: {nearest} to {farthest} holds nothing; give the nearer distance first.")
    everywhere = np.full(2, np.inf)
    return _match_rectangle(cloud, camera, -everywhere, everywhere, (nearest, farthest), world_from_object, look)


def match_polygon(
    cloud: EditableCloud,
    camera: Camera,
    corners_px: npt.ArrayLike,
    world_from_object: npt.ArrayLike | None = None,
    look: Look = PLAIN,
) -> Mask:
    """Splats whose mean is seen inside a lasso (V, 2) [px], closed from its last corner to its first.

    Where the line crosses itself, even-odd decides. Raises StippleError for fewer than three corners.
    """
    corners = np.asarray(corners_px, np.float32)
    if corners.ndim != 2 or corners.shape[1] != 2 or len(corners) < 3 or not np.isfinite(corners).all():
        raise StippleError("lasso: give at least three corners as finite (x, y) pairs.")
    edges, first_edge, first_row = edges_by_row(corners)
    view, pose = _seen(camera, world_from_object, look)
    hits = cloud.hits()
    device = cloud.device
    on_device = [wp.array(edges, dtype=wp.vec4, device=device), wp.array(first_edge, dtype=wp.int32, device=device)]
    inputs = [*_shown_arrays(cloud, look), view, pose, *on_device, first_row, hits]
    launch(match_polygon_kernel, cloud.splat_count, inputs, device)
    return mask_from_hits(hits, cloud.splat_count)


def edges_by_row(
    corners: npt.NDArray[np.float32],
) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.int32], int]:
    """A polygon's edges sorted by the rows of pixels they pass, so that a splat is tested against a few, not all.

    Returns edges (E, 4), the first edge of each row and one past the last (R + 1,), and the first row's number. An edge
    stands in every row it touches.
    """
    edges = np.hstack([corners, np.roll(corners, -1, axis=0)])
    rows = np.floor(np.sort(edges[:, 1::2], axis=1)).astype(np.int64)
    first_row, last_row = int(rows[:, 0].min()), int(rows[:, 1].max())
    lengths = rows[:, 1] - rows[:, 0] + 1
    edge = np.repeat(np.arange(len(edges)), lengths)
    step = np.arange(lengths.sum()) - np.repeat(np.cumsum(lengths) - lengths, lengths)
    row = rows[edge, 0] + step - first_row
    order = np.argsort(row, kind="stable")
    first_edge = np.searchsorted(row[order], np.arange(last_row - first_row + 2)).astype(np.int32)
    return np.ascontiguousarray(edges[edge[order]]), first_edge, first_row


def _seen(camera: Camera, world_from_object: npt.ArrayLike | None, look: Look) -> tuple[View, Pose]:
    matrix, settings = checked(world_from_object, "world_from_object"), Settings()
    return make_view(camera, settings), make_pose(camera, matrix, make_device_look(look, matrix, settings))


def _shown_arrays(cloud: EditableCloud, look: Look, border: bool = False) -> tuple[wp.array, wp.array, wp.array]:
    """What `shown_splat` needs: means; for borders scales; opacities, also where the display leaves faint ones out."""
    opacity = _array_if(border or look.display != "splats", cloud, "opacity")
    return cloud.array("position"), _array_if(border, cloud, "scale"), opacity


def _array_if(wanted: bool, cloud: EditableCloud, name: str) -> wp.array:
    return cloud.array(name) if wanted else wp.empty(0, dtype=ELEMENTS[name], device=cloud.device)


def _match_rectangle(
    cloud: EditableCloud,
    camera: Camera,
    low: npt.NDArray[np.float64],
    high: npt.NDArray[np.float64],
    depths: tuple[float, float],
    world_from_object: npt.ArrayLike | None,
    look: Look,
) -> Mask:
    view, pose = _seen(camera, world_from_object, look)
    hits = cloud.hits()
    inputs = [*_shown_arrays(cloud, look), view, pose, wp.vec2(*low), wp.vec2(*high), wp.vec2(*depths), hits]
    launch(match_box_kernel, cloud.splat_count, inputs, cloud.device)
    return mask_from_hits(hits, cloud.splat_count)
