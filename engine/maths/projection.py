# SPDX-License-Identifier: GPL-3.0-or-later
"""How a Gaussian in space becomes an ellipse on the screen.

The projection is 3D Gaussian Splatting's (Kerbl et al. 2023, doi 10.1145/3592433; EWA splatting): the perspective is
replaced by its first-order expansion at the mean, the covariance is carried through it, and `dilation_px2` is added on
the diagonal. As there, x/z and y/z enter the expansion clamped to 1.3 × the field of view (gsplat's form of the limit,
which equals INRIA's for a centred principal point), always of the whole frame, never of a render window.

Where we differ: determinants are sums of squares (Cauchy-Binet), so that a needle a thousand pixels long keeps its
width in single precision; INRIA subtracts two nearly equal products. And a splat ends where its opacity falls below
`alpha_min`, not at the tiles of a 3 σ square.
"""

from __future__ import annotations

import numpy as np
import warp as wp

from ..camera import Camera
from ..device_look import DeviceLook
from ..settings import Settings

wp.set_module_options({"enable_backward": False})

LARGEST_PX = wp.constant(1e8)
DEPTH_KEY_BITS = 28
DEPTH_KEY_LARGEST = wp.constant(wp.uint32((1 << DEPTH_KEY_BITS) - 2))  # all ones stands for nothing


@wp.struct
class View:
    """Camera and projection settings as kernels read them.

    Pixels count from the whole frame's corner until a pixel's index is taken, so that a window changes no bit.
    """

    focal_px: wp.vec2
    centre_px: wp.vec2
    slope_low: wp.vec2  # limits of x/z and y/z in the expansion
    slope_high: wp.vec2
    frame_px: wp.vec2  # size of the whole frame
    window_low: wp.vec2  # corners of the rendered part [px]
    window_high: wp.vec2
    near: wp.float32
    far: wp.float32
    depth_origin: wp.float32  # subtracted from z before it becomes a sort key
    depth_key_first: wp.uint32
    orthographic: wp.int32
    alpha_min: wp.float32
    alpha_max: wp.float32


@wp.struct
class Pose:
    """One instance as seen by the camera."""

    linear: wp.mat33  # camera_from_object
    translation: wp.vec3
    eye_object: wp.vec3  # the camera's position in object space
    forward_object: wp.vec3  # an orthographic camera's view direction in object space
    look: DeviceLook


@wp.struct
class Ellipse:
    """A projected splat. `determinant` is that of the dilated covariance [px⁴]."""

    mean_px: wp.vec2
    xx: wp.float32
    xy: wp.float32
    yy: wp.float32
    determinant: wp.float32
    opacity: wp.float32


def make_view(camera: Camera, settings: Settings) -> View:
    x, y, width, height = camera.rendered_window
    margin = np.array([0.15 * camera.width / camera.fx, 0.15 * camera.height / camera.fy])  # 0.3 tan(fov/2)
    focal = np.array([camera.fx, camera.fy])
    centre = np.array([camera.cx, camera.cy])
    view = View()
    view.focal_px = wp.vec2(*focal)
    view.centre_px = wp.vec2(*centre)
    view.slope_low = wp.vec2(*(-centre / focal - margin))
    view.slope_high = wp.vec2(*((np.array([camera.width, camera.height]) - centre) / focal + margin))
    view.frame_px = wp.vec2(float(camera.width), float(camera.height))
    view.window_low = wp.vec2(float(x), float(y))
    view.window_high = wp.vec2(float(x + width), float(y + height))
    view.near, view.far = camera.near, camera.far
    view.orthographic = int(camera.projection == "orthographic")
    # An orthographic near plane may lie behind the camera; keys need positive depths.
    view.depth_origin = camera.near - 1e-6 * (camera.far - camera.near) if view.orthographic else 0.0
    # 28 bits of a float hold 32 octaves without loss: from near on, or the last 32 before far.
    nearest = max(camera.near - view.depth_origin, (camera.far - view.depth_origin) * 2.0**-31)
    view.depth_key_first = int(np.float32(nearest).view(np.uint32))
    view.alpha_min, view.alpha_max = settings.alpha_min, settings.alpha_max
    return view


def make_pose(camera: Camera, world_from_object: np.ndarray, look: DeviceLook) -> Pose:
    """Composed in float64, so that far-off world coordinates cancel before they are rounded."""
    rotation = camera.camera_from_world[:, :3]
    linear = rotation @ world_from_object[:, :3]
    translation = rotation @ world_from_object[:, 3] + camera.camera_from_world[:, 3]
    inverse = np.linalg.pinv(linear)  # a flattened object (scale 0 along an axis) still renders
    forward = inverse @ np.array([0.0, 0.0, 1.0])
    pose = Pose()
    pose.linear = wp.mat33(*linear.ravel())
    pose.translation = wp.vec3(*translation)
    pose.eye_object = wp.vec3(*(-inverse @ translation))
    pose.forward_object = wp.vec3(*(forward / max(np.linalg.norm(forward), 1e-30)))
    pose.look = look
    return pose


@wp.func
def depth_key(z: wp.float32, view: View) -> wp.uint32:
    """28 bits that order depths as single-precision floats do: no quantisation, so no ties that z does not have."""
    bits = wp.cast(z - view.depth_origin, wp.uint32)
    if bits <= view.depth_key_first:
        return wp.uint32(0)
    return wp.min(bits - view.depth_key_first, DEPTH_KEY_LARGEST)


@wp.struct
class Footprint:
    """Pixels that a splat or a group of splats may touch: between two corners of the frame, if at all."""

    seen: wp.bool
    low: wp.vec2
    high: wp.vec2


@wp.func
def touching(view: View, low: wp.vec2, high: wp.vec2) -> Footprint:
    """What lies between two corners; seen if the window overlaps it. NaN fails every comparison and is never seen."""
    f = Footprint()
    f.low = low
    f.high = high
    f.seen = (
        high[0] > view.window_low[0]
        and high[1] > view.window_low[1]
        and low[0] < view.window_high[0]
        and low[1] < view.window_high[1]
    )
    return f


@wp.func
def footprint(view: View, pose: Pose, p: wp.vec3, scale: wp.vec3, opacity: wp.float32) -> Footprint:
    """Not seen only if the splat touches no pixel: outside the clipping range, too faint, or beside the window.

    `p` is its mean in camera space, `scale` and `opacity` are those of the dressed splat. Cheap: bounds the ellipse by
    the circle of the largest scale.
    """
    if not (p[2] > view.near and p[2] < view.far and opacity >= view.alpha_min):
        return Footprint()
    linear = pose.linear
    stretch = wp.sqrt(wp.ddot(linear, linear))
    sigma = wp.max(scale) * stretch
    inverse_z = float(1.0)
    tilt = float(1.0)
    if view.orthographic == 0:
        inverse_z = 1.0 / p[2]
        sx = wp.max(wp.abs(view.slope_low[0]), wp.abs(view.slope_high[0]))
        sy = wp.max(wp.abs(view.slope_low[1]), wp.abs(view.slope_high[1]))
        tilt = wp.sqrt(1.0 + wp.max(sx * sx, sy * sy))
    sigma_px = wp.max(view.focal_px) * inverse_z * tilt * sigma
    # 3.34 σ is where full opacity falls below 1/255; one pixel more for rounding.
    reach = wp.sqrt(2.0 * wp.log(opacity / view.alpha_min) + 1e-4)
    radius = reach * wp.sqrt(sigma_px * sigma_px + pose.look.dilation_px2) * 1.001 + 1.0
    mean = wp.vec2(
        view.focal_px[0] * p[0] * inverse_z + view.centre_px[0],
        view.focal_px[1] * p[1] * inverse_z + view.centre_px[1],
    )
    return touching(view, mean - wp.vec2(radius, radius), mean + wp.vec2(radius, radius))


@wp.func
def within(w: wp.vec3) -> wp.vec3:
    """No longer than LARGEST_PX along any axis, so that determinants stay finite: such a splat fills any frame."""
    low, high = wp.vec3(-LARGEST_PX, -LARGEST_PX, -LARGEST_PX), wp.vec3(LARGEST_PX, LARGEST_PX, LARGEST_PX)
    return wp.min(wp.max(w, low), high)


@wp.func
def project_splat(
    view: View, pose: Pose, p: wp.vec3, scale: wp.vec3, rotation: wp.vec4, opacity: wp.float32
) -> Ellipse:
    """Ellipse of a splat whose mean is at `p` in camera space, in front of the camera."""
    inverse_z = float(1.0)
    slope_x = float(0.0)
    slope_y = float(0.0)
    if view.orthographic == 0:
        inverse_z = 1.0 / p[2]
        slope_x = wp.clamp(p[0] * inverse_z, view.slope_low[0], view.slope_high[0])
        slope_y = wp.clamp(p[1] * inverse_z, view.slope_low[1], view.slope_high[1])
    fx = view.focal_px[0] * inverse_z
    fy = view.focal_px[1] * inverse_z
    # Rows of J · linear, turned into the splat's principal axes and scaled: covariance = w wᵀ.
    to_object = wp.transpose(pose.linear)
    axes = wp.quat(rotation[1], rotation[2], rotation[3], rotation[0])
    w0 = within(wp.cw_mul(scale, wp.quat_rotate_inv(axes, to_object * wp.vec3(fx, 0.0, -fx * slope_x))))
    w1 = within(wp.cw_mul(scale, wp.quat_rotate_inv(axes, to_object * wp.vec3(0.0, fy, -fy * slope_y))))
    e = Ellipse()
    e.mean_px = wp.vec2(
        view.focal_px[0] * p[0] * inverse_z + view.centre_px[0],
        view.focal_px[1] * p[1] * inverse_z + view.centre_px[1],
    )
    e.xx = wp.dot(w0, w0)
    e.xy = wp.dot(w0, w1)
    e.yy = wp.dot(w1, w1)
    undilated = wp.length_sq(wp.cross(w0, w1))
    dilation = pose.look.dilation_px2
    e.determinant = undilated + dilation * (e.xx + e.yy + dilation)
    e.xx += dilation
    e.yy += dilation
    e.opacity = opacity
    if pose.look.antialiased != 0:
        # Mip-Splatting (Yu et al. 2024): what the dilation adds in area it must lose in opacity.
        e.opacity = opacity * wp.sqrt(wp.max(undilated / e.determinant, 0.000025))
    return e
