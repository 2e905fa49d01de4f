# SPDX-License-Identifier: GPL-3.0-or-later
"""Whether any ray of the window meets a splat's support (RayGS, section 3.2): what is not met is not drawn.

Whole quads are culled, and none is clipped (section 4.1, "A note on near plane clipping"). Three tests, each dearer:
the mean's depth and opacity; a sphere around the support; and where those leave it open, the quad of Eq. 15.

**No pixel may change.** The shaders decide for themselves, in single precision, and their roundings are not these.
Both results are those of an exact computation for a primitive that differs by a few roundings: M by `ROUNDING` ‖M‖,
μ by less. For such a primitive M' M'ᵀ ≼ (1 + t) M Mᵀ + (1 + 1/t) `ROUNDING`² ‖M‖² I for any t > 0 (twice the product of
two numbers is at most t times one square and 1/t times the other), and a larger covariance has a larger support, for
D_ray falls. So the quad is made for the right-hand side, with t = `SPREAD`; with a p_min that is lower by as much, for
logarithm, exponential and interpolation; and for a window larger by `MARGIN_PX`, for the rasteriser's 1/256 px. Whether
c² <= κ (Prop. A.2) hangs on the last bit for flat splats seen edge-on, and few splats surround a camera: those stay.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import warp as wp

from ..camera import Camera
from ..device_cloud import DeviceCloud, Splat, read_rotation
from ..device_look import opaque_from
from ..maths.projection import Pose, View
from .raygs import LARGEST_S, column, principal_axes, quad_of, squared_area_across
from .texels import jacobi_sweeps

wp.set_module_options({"enable_backward": False})

MARGIN_PX = 2.0  # a viewport's border is rounded to pixels of its coarsest picture besides
ROUNDING = wp.constant(4e-6)  # 64 units in the last place
SPREAD = wp.constant(0.01)  # t
MEAN_SLACK = wp.constant(5e-10)  # [units²] (1 + 1/t) δ² / κ for a mean off by δ = 3e-7, at the least κ there is, 0.02


@wp.struct
class Frustum:
    """Planes n · p + d >= 0 in camera space, |n| = 1, a little outside the window's edges."""

    left: wp.vec4
    right: wp.vec4
    top: wp.vec4
    bottom: wp.vec4
    finest_px: wp.float32  # what is drawn may have pixels down to so many times the camera's


@wp.struct
class Deformation:
    """What an instance's linear part does to lengths and angles."""

    stretch: wp.float32  # the largest factor on a length
    sweeps: wp.int32  # of Jacobi's rotations (`principal_axes`); 0 where angles are kept and all factors are `stretch`


def make_frustum(camera: Camera, finest_px: float = 1.0) -> Frustum:
    x, y, width, height = camera.rendered_window
    orthographic = camera.projection == "orthographic"
    edges = (
        (0, 1.0, (x - MARGIN_PX - camera.cx) / camera.fx),
        (0, -1.0, (x + width + MARGIN_PX - camera.cx) / camera.fx),
        (1, 1.0, (y - MARGIN_PX - camera.cy) / camera.fy),
        (1, -1.0, (y + height + MARGIN_PX - camera.cy) / camera.fy),
    )
    planes = []
    for axis, sign, slope in edges:
        plane = np.zeros(4)
        plane[axis] = sign
        plane[3 if orthographic else 2] = -sign * slope
        planes.append(wp.vec4(*(plane / np.linalg.norm(plane[:3]))))
    frustum = Frustum()
    frustum.left, frustum.right, frustum.top, frustum.bottom = planes
    frustum.finest_px = finest_px
    return frustum


def make_deformation(camera: Camera, world_from_object: npt.NDArray[np.float64]) -> Deformation:
    linear = camera.camera_from_world[:, :3] @ world_from_object[:, :3]
    deformation = Deformation()
    deformation.stretch = float(np.linalg.norm(linear, 2)) * (1.0 + 1e-6)  # kept from rounding below
    deformation.sweeps = jacobi_sweeps(linear)
    return deformation


@wp.struct
class Primitive:
    """A splat as `quad_of` takes it: in camera space, in units of the mean's distance (orthographic: of a pixel)."""

    mu: wp.vec3
    x: wp.vec3  # the ray through the mean
    M: wp.mat33
    unit: wp.float32  # [world units]
    o: wp.float32
    filter_variance: wp.float32


@wp.func
def prior_opacity(opacity: wp.float32) -> wp.float32:
    """o of a dressed splat: at most 1, unless it stands for another display."""
    return wp.where(opacity >= opaque_from, opacity, wp.min(opacity, 1.0))


@wp.func
def primitive_of(view: View, pose: Pose, p: wp.vec3, splat: Splat, rotation: wp.vec4) -> Primitive:
    """As `vertex.glsl` makes one. `p` is the mean in camera space, `splat` is dressed."""
    parallel = view.orthographic != 0
    primitive = Primitive()
    largest = wp.max(wp.abs(p))
    unit = largest * wp.length(p / largest)
    if parallel:
        unit = 1.0 / wp.max(view.focal_px)
    primitive.unit = unit
    primitive.mu = p / unit
    scale = splat.scale / unit
    turned = pose.linear * wp.quat_to_matrix(wp.quat(rotation[1], rotation[2], rotation[3], rotation[0]))
    m0, m1, m2 = column(turned, 0), column(turned, 1), column(turned, 2)
    primitive.M = wp.matrix_from_cols(
        m0 * wp.min(scale[0], LARGEST_S / wp.max(wp.length(m0), 1e-20)),
        m1 * wp.min(scale[1], LARGEST_S / wp.max(wp.length(m1), 1e-20)),
        m2 * wp.min(scale[2], LARGEST_S / wp.max(wp.length(m2), 1e-20)),
    )
    # Section 5: a pixel's area where the mean is, across the ray. (mu's z is the cosine: mu has length 1.)
    z = primitive.mu[2]
    across = wp.where(parallel, 1.0 / (unit * unit), z * z * z)
    primitive.filter_variance = pose.look.dilation_px2 / (view.focal_px[0] * view.focal_px[1]) * across
    primitive.x = wp.where(parallel, wp.vec3(0.0, 0.0, 1.0), primitive.mu)
    primitive.o = prior_opacity(splat.opacity)
    return primitive


@wp.func
def beyond(plane: wp.vec4, p: wp.vec3) -> wp.float32:
    return plane[0] * p[0] + plane[1] * p[1] + plane[2] * p[2] + plane[3]


@wp.func
def is_too_faint(primitive: Primitive, sweeps: wp.int32, finest_px: wp.float32, p_min: wp.float32) -> wp.bool:
    """Whether Eq. 17 takes κ to 0 or below (section 3) in pixels down to `finest_px` times the view's.

    The factor grows with the covariance and falls with the filter. From below the filtered covariance is bounded as
    from above, where the filter is more than 100 roundings wide; where it is not, the answer is no.
    """
    filter_variance = primitive.filter_variance * finest_px * finest_px
    rounding2 = ROUNDING * ROUNDING * wp.ddot(primitive.M, primitive.M)
    if not filter_variance > rounding2 / (SPREAD * SPREAD):
        return False
    axes, s = principal_axes(primitive.M, sweeps)
    towards = wp.transpose(axes) * primitive.x
    most, least = wp.vec3(), wp.vec3()
    for k in range(3):
        most[k] = wp.sqrt((1.0 + SPREAD) * s[k] * s[k] + rounding2 * (1.0 + 1.0 / SPREAD))
        least[k] = wp.sqrt((1.0 - SPREAD) * (s[k] * s[k] + filter_variance))
    factor2 = squared_area_across(most, towards) / squared_area_across(least, towards)
    return primitive.o * wp.sqrt(factor2) * (1.0 + SPREAD) <= p_min


@wp.func
def is_beside(
    frustum: Frustum, primitive: Primitive, sweeps: wp.int32, p_min: wp.float32, parallel: wp.bool
) -> wp.bool:
    """Whether the support lies beyond one of the window's planes.

    A plane's distance to T_ray H(z) (Eq. 15) is linear in z: over the disc of radius √κ / b, which holds the support,
    it is the mean's and at most √κ / b · |(n · q0, n · q1)| more. What a ray of the support meets in front of the
    camera is a positive multiple of a point of the disc (τ > 0, Prop. A.3): on its side of a plane through the eye.
    """
    slack = (1.0 + 1.0 / SPREAD) * ROUNDING * ROUNDING * wp.ddot(primitive.M, primitive.M) + MEAN_SLACK
    widened = wp.sqrt(1.0 + SPREAD) * primitive.M
    filtered = (1.0 + SPREAD) * primitive.filter_variance + slack
    p_least = (1.0 - SPREAD) * p_min
    quad = quad_of(primitive.x, widened, sweeps, primitive.o, filtered, p_least, False, parallel)
    if not quad.visible:
        return False
    inside = float(1e30)
    for k in range(4):
        plane = frustum.left
        if k == 1:
            plane = frustum.right
        elif k == 2:
            plane = frustum.top
        elif k == 3:
            plane = frustum.bottom
        n = wp.vec3(plane[0], plane[1], plane[2])
        distance = wp.dot(n, primitive.mu) + plane[3] / primitive.unit
        reach = quad.z_ray * wp.length(wp.vec2(wp.dot(n, quad.q0), wp.dot(n, quad.q1)))
        inside = wp.min(inside, distance + reach)
    return inside < 0.0


@wp.func
def surely_shows(scale: wp.vec3, filter_variance: wp.float32, o: wp.float32, p_min: wp.float32) -> wp.bool:
    """Whether Eq. 17 leaves κ above 0 from wherever the splat is seen; cheap, and never wrong about yes.

    The two variances across a ray are at least the two smallest of the three (Cauchy's interlacing), and the square of
    Eq. 17's factor is the product of variance over variance with filter. `scale` and `filter_variance` in one unit.
    """
    least = wp.min(scale)
    middle = wp.max(wp.min(scale[0], scale[1]), wp.min(wp.max(scale[0], scale[1]), scale[2]))
    least2, middle2 = least * least, middle * middle
    factor2 = least2 / (least2 + filter_variance) * (middle2 / (middle2 + filter_variance))
    return o * o * factor2 > p_min * p_min


@wp.func
def may_be_met(
    view: View,
    frustum: Frustum,
    pose: Pose,
    deformation: Deformation,
    cloud: DeviceCloud,
    i: wp.int32,
    p: wp.vec3,
    splat: Splat,
) -> wp.bool:
    """False only for splats whose support no ray of the window meets. NaN fails every comparison and is never seen.

    `p` is the mean in camera space, `splat` is number `i` of the cloud, dressed.
    """
    if not (p[2] > view.near and p[2] < view.far and splat.opacity > view.alpha_min):
        return False
    if not wp.length_sq(splat.scale) >= 0.0:  # a NaN, which neither max here nor min in the shader need let through
        return False
    o = prior_opacity(splat.opacity)
    # A ray of the support passes within √κ standard deviations of the mean (section 3): within that sphere.
    kappa = -2.0 * wp.log(view.alpha_min / o)
    depth = wp.where(view.orthographic != 0, 1.0, p[2])
    pixel2 = pose.look.dilation_px2 / (view.focal_px[0] * view.focal_px[1]) * depth * depth
    radius = wp.sqrt(kappa) * (wp.max(wp.abs(splat.scale)) * deformation.stretch + wp.sqrt(pixel2)) * (1.0 + SPREAD)
    inside = wp.min(
        wp.min(beyond(frustum.left, p), beyond(frustum.right, p)),
        wp.min(beyond(frustum.top, p), beyond(frustum.bottom, p)),
    )
    if not inside > -radius:
        return False
    may_be_faint = pose.look.antialiased != 0
    if may_be_faint and deformation.sweeps == 0:
        may_be_faint = not surely_shows(splat.scale * deformation.stretch, pixel2, o, view.alpha_min)
    within = inside >= radius
    if within and not may_be_faint:
        return True
    primitive = primitive_of(view, pose, p, splat, read_rotation(cloud, i))
    sweeps = deformation.sweeps
    if may_be_faint and is_too_faint(primitive, sweeps, frustum.finest_px, view.alpha_min):
        return False
    return within or not is_beside(frustum, primitive, sweeps, view.alpha_min, view.orthographic != 0)
