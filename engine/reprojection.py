# SPDX-License-Identifier: GPL-3.0-or-later
"""Carry a moving camera's last picture over to the next, against noise (§3.6 of doi 10.1145/3811272).

Each pixel's place in space is looked up in the picture before (Yang et al. 2020, *A Survey of Temporal Antialiasing
Techniques*, Eq. 1), that colour is clamped to the box of the 3×3 pixels around in the new picture, and enters with a
weight of 0.9. Good for looking around; it smears fine detail and leaves ghosts, so final frames never use it.

Only splats are carried over, premultiplied, and then put over the new view's background: an image around the scene has
no noise, and looking it up in one picture after the other would only blur it.

Where we differ: depth is the mean of what a pixel sees, not the least over its subpixels (the same for one subpixel);
where nothing is seen the direction is looked up. Pixels that the picture before does not show take the new colour.
"""

from __future__ import annotations

import numpy as np
import warp as wp

from .buffers import Buffers
from .camera import Camera
from .device import launch

wp.set_module_options({"enable_backward": False})

HISTORY_WEIGHT = 0.9


@wp.struct
class Lens:
    """How a camera projects, pixels counted in its window."""

    focal_px: wp.vec2
    centre_px: wp.vec2
    size_px: wp.vec2i
    orthographic: wp.int32


@wp.struct
class Move:
    """From the camera now to the camera before."""

    now: Lens
    before: Lens
    linear: wp.mat33
    translation: wp.vec3


def lens_of(camera: Camera) -> Lens:
    x, y, width, height = camera.rendered_window
    lens = Lens()
    lens.focal_px = wp.vec2(camera.fx, camera.fy)
    lens.centre_px = wp.vec2(camera.cx - x, camera.cy - y)
    lens.size_px = wp.vec2i(width, height)
    lens.orthographic = int(camera.projection == "orthographic")
    return lens


def move_between(now: Camera, before: Camera) -> Move:
    """Composed in float64, so that far-off world coordinates cancel."""
    to_before = np.vstack([before.camera_from_world, (0, 0, 0, 1)])
    to_now = np.vstack([now.camera_from_world, (0, 0, 0, 1)])
    before_from_now = to_before @ np.linalg.inv(to_now)
    move = Move()
    move.now, move.before = lens_of(now), lens_of(before)
    move.linear = wp.mat33(*before_from_now[:3, :3].ravel())
    move.translation = wp.vec3(*before_from_now[:3, 3])
    return move


@wp.func
def pixel_before(move: Move, x: wp.float32, y: wp.float32, depth: wp.float32) -> wp.vec3:
    """Where the camera before saw what is now at pixel (x, y): x, y [px], and 1, or 0 if it was behind that camera."""
    lens = move.now
    far = not depth < 1e30
    z = wp.where(far, 1.0, depth)
    scale = wp.where(lens.orthographic != 0, 1.0, z)
    p = wp.vec3(
        (x - lens.centre_px[0]) / lens.focal_px[0] * scale, (y - lens.centre_px[1]) / lens.focal_px[1] * scale, z
    )
    q = move.linear * p
    if not far:
        q = q + move.translation
    inverse = float(1.0)
    if move.before.orthographic == 0:
        if q[2] <= 1e-6 * wp.length(q):
            return wp.vec3(0.0, 0.0, 0.0)
        inverse = 1.0 / q[2]
    return wp.vec3(
        q[0] * inverse * move.before.focal_px[0] + move.before.centre_px[0],
        q[1] * inverse * move.before.focal_px[1] + move.before.centre_px[1],
        1.0,
    )


@wp.func
def interpolated(picture: wp.array(dtype=wp.vec4), size: wp.vec2i, x: wp.float32, y: wp.float32) -> wp.vec4:
    """Between pixel centres, linearly; the edge is continued by half a pixel."""
    u = wp.clamp(x - 0.5, 0.0, float(size[0] - 1))
    v = wp.clamp(y - 0.5, 0.0, float(size[1] - 1))
    x0, y0 = int(u), int(v)
    x1, y1 = wp.min(x0 + 1, size[0] - 1), wp.min(y0 + 1, size[1] - 1)
    top = wp.lerp(picture[y0 * size[0] + x0], picture[y0 * size[0] + x1], u - float(x0))
    bottom = wp.lerp(picture[y1 * size[0] + x0], picture[y1 * size[0] + x1], u - float(x0))
    return wp.lerp(top, bottom, v - float(y0))


@wp.kernel
def reproject_kernel(
    first: wp.int32,
    move: Move,
    weight: wp.float32,
    now: wp.array(dtype=wp.vec4),
    depth: wp.array(dtype=wp.float32),
    before: wp.array(dtype=wp.vec4),
    mixed: wp.array(dtype=wp.vec4),
) -> None:
    pixel = first + wp.tid()
    columns, rows = move.now.size_px[0], move.now.size_px[1]
    y = pixel / columns
    x = pixel - y * columns
    colour = now[pixel]
    place = pixel_before(move, float(x) + 0.5, float(y) + 0.5, depth[pixel])
    inside = place[0] >= 0.0 and place[1] >= 0.0
    inside = inside and place[0] <= float(move.before.size_px[0]) and place[1] <= float(move.before.size_px[1])
    if place[2] > 0.0 and inside:
        low, high = colour, colour
        for neighbour in range(9):
            nx = wp.clamp(x + neighbour % 3 - 1, 0, columns - 1)
            ny = wp.clamp(y + neighbour / 3 - 1, 0, rows - 1)
            low = wp.min(low, now[ny * columns + nx])
            high = wp.max(high, now[ny * columns + nx])
        history = interpolated(before, move.before.size_px, place[0], place[1])
        colour = wp.lerp(colour, wp.min(wp.max(history, low), high), weight)
    mixed[pixel] = colour


class History:
    """The splats of the last picture that was shown, and the camera they were seen with."""

    def __init__(self) -> None:
        self._camera: Camera | None = None

    def mix(self, rgba: wp.array, depth: wp.array, camera: Camera, buffers: Buffers) -> None:
        """Mix the last picture into `rgba` (premultiplied, without a background), and remember the result.

        `depth` is along z [world units], +inf where nothing is seen. A first picture stays as it is.
        """
        count = rgba.size
        if self._camera is not None:
            before = self._camera
            held = buffers.array("history", wp.vec4, before.rendered_window[2] * before.rendered_window[3])
            mixed = buffers.array("history_mixed", wp.vec4, count)
            inputs = [move_between(camera, before), HISTORY_WEIGHT, rgba, depth, held, mixed]
            launch(reproject_kernel, count, inputs, buffers.device)
            wp.copy(rgba, mixed, count=count)
        wp.copy(buffers.array("history", wp.vec4, count), rgba, count=count)
        self._camera = camera

    def forget(self) -> None:
        self._camera = None
