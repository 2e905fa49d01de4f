# SPDX-License-Identifier: GPL-3.0-or-later
"""A look on the device, and the two places where it acts: on a splat before projection, on its colour after.

Points and ellipsoids need no kernels of their own. They are splats of an opacity far above 1: it is cut to 1 per pixel
as far as the Gaussian lets it, so the Gaussian becomes a disc with a soft edge, 5 % of its radius wide. Scaled until
that edge lies where it should, it travels through every stage of every method like any splat.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
import warp as wp

from .device_cloud import Splat
from .look import MOST_CROPS, Look, crop_from_object
from .settings import Settings
from .splats import MAX_SH_DEGREE

wp.set_module_options({"enable_backward": False})

OPAQUE = 1e24  # opacities from here on are cut to 1 and not to alpha_max; exp(-80) times it is still nothing
SHADED = 1e25  # and from here on the splat is shaded
SHADED_EDGE2 = 2.0 * math.log(2.0 * SHADED)  # squared standard deviations to where such an opacity has fallen to ½
RIM_SHADE = 0.35  # brightness at the rim of a shaded splat, 1 in its middle
SHADE_SLOPE = (1.0 - RIM_SHADE) / SHADED_EDGE2
ELLIPSOID = 1.5  # standard deviations to an ellipsoid's surface; then those of a surface touch
LEAST_RADIUS_PX = 0.5  # of an ellipsoid, or small ones would slip between the pixels' centres

opaque_from = wp.constant(OPAQUE)
shaded_from = wp.constant(SHADED)
shade_slope = wp.constant(SHADE_SLOPE)
rim_shade = wp.constant(RIM_SHADE)
UNSEEN = wp.constant(-1.0)  # an opacity below every alpha_min

CropRows = wp.types.matrix(shape=(3 * MOST_CROPS, 4), dtype=wp.float32)


@wp.struct
class DeviceLook:
    """A `Look` for one placement, and what of the settings it may override. Bit k of a set is crop number k."""

    size: wp.float32
    opacity: wp.float32
    least_opacity: wp.float32
    shown_opacity: wp.float32  # of every splat that is displayed as something else; 0 for splats
    dilation_px2: wp.float32
    antialiased: wp.int32
    sh_degree: wp.int32
    graded: wp.int32
    light: wp.mat33  # of linear Rec.709 light
    crop_count: wp.int32
    spheres: wp.int32  # set of crops
    outside: wp.int32  # set of crops
    crops: CropRows  # three rows of crop_from_object for each


def make_device_look(look: Look, world_from_object: npt.NDArray[np.float64], settings: Settings) -> DeviceLook:
    result = DeviceLook()
    degrees = [MAX_SH_DEGREE, settings.sh_degree, look.sh_degree]
    result.sh_degree = min(degree for degree in degrees if degree is not None)
    result.opacity, result.least_opacity = look.opacity, look.least_opacity
    result.size, result.dilation_px2 = look.size, settings.dilation_px2
    result.antialiased = int(settings.antialiased if look.antialiased is None else look.antialiased)
    if look.display != "splats":
        as_points = look.display == "points"
        result.shown_opacity = OPAQUE if as_points else SHADED
        result.antialiased = 0
        edge = math.sqrt(2.0 * math.log(2.0 * result.shown_opacity))  # standard deviations
        radius_px = 0.5 * look.point_px * settings.point_scale if as_points else LEAST_RADIUS_PX
        result.size = 0.0 if as_points else look.size * ELLIPSOID / edge
        result.dilation_px2 = (radius_px / edge) ** 2
    light = look.light_matrix()
    result.graded = int(light is not None)
    if light is not None:
        result.light = wp.mat33(*light.ravel())
    rows = np.zeros((MOST_CROPS, 3, 4))
    for k, crop in enumerate(look.crops):
        rows[k] = crop_from_object(crop, world_from_object)
    result.crop_count = len(look.crops)
    result.spheres = sum(1 << k for k, crop in enumerate(look.crops) if crop.shape == "sphere")
    result.outside = sum(1 << k for k, crop in enumerate(look.crops) if crop.keep == "outside")
    result.crops = CropRows(*rows.ravel())
    return result


@wp.func
def is_kept(look: DeviceLook, position: wp.vec3) -> wp.bool:
    """Whether the crops keep a splat: inside any that keeps the inside, outside all that keep the outside."""
    p = wp.vec4(position[0], position[1], position[2], 1.0)
    any_inside = int(0)
    found = int(0)
    for k in range(look.crop_count):
        x = wp.dot(look.crops[3 * k], p)  # type: ignore[index]
        y = wp.dot(look.crops[3 * k + 1], p)  # type: ignore[index]
        z = wp.dot(look.crops[3 * k + 2], p)  # type: ignore[index]
        within = wp.abs(x) <= 1.0 and wp.abs(y) <= 1.0 and wp.abs(z) <= 1.0
        if ((look.spheres >> k) & 1) != 0:
            within = x * x + y * y + z * z <= 1.0
        if ((look.outside >> k) & 1) != 0:
            if within:
                return False
        else:
            any_inside = 1
            if within:
                found = 1
    return found == any_inside


@wp.func
def dressed_opacity(opacity: wp.float32, look: DeviceLook) -> wp.float32:
    """An opacity as the look shows it: scaled, or that of the display. Grows with `opacity`."""
    shown = opacity
    if look.opacity != 1.0:
        scaled = look.opacity * opacity
        shown = wp.where(scaled > 1.0, 1.0, scaled)
    if look.shown_opacity > 0.0:
        shown = wp.where(shown >= look.least_opacity, look.shown_opacity, UNSEEN)
    return shown


@wp.func
def dressed(splat: Splat, look: DeviceLook) -> Splat:
    """The splat as the look shows it; one that is cropped away has an opacity below 0."""
    shown = Splat()
    shown.position = splat.position
    shown.scale = look.size * splat.scale
    shown.opacity = dressed_opacity(splat.opacity, look)
    if look.crop_count > 0 and not is_kept(look, splat.position):
        shown.opacity = UNSEEN
    return shown


@wp.func
def light_of(encoded: wp.float32) -> wp.float32:
    """sRGB-encoded to linear, for values from 0 on (IEC 61966-2-1; above 1 the same power law)."""
    if encoded <= 0.04045:
        return encoded / 12.92
    return wp.pow((encoded + 0.055) / 1.055, 2.4)


@wp.func
def encoded_of(light: wp.float32) -> wp.float32:
    """The inverse of `light_of`; what is not above 0, NaN too, becomes 0."""
    if not light > 0.0:
        return 0.0
    if light <= 0.0031308:
        return light * 12.92
    return 1.055 * wp.pow(light, 1.0 / 2.4) - 0.055


@wp.func
def graded(colour: wp.vec3, look: DeviceLook) -> wp.vec3:
    """A splat's colour as the look shows it, sRGB-encoded as `colour` is."""
    if look.graded == 0:
        return colour
    light = look.light * wp.vec3(light_of(colour[0]), light_of(colour[1]), light_of(colour[2]))
    return wp.vec3(encoded_of(light[0]), encoded_of(light[1]), encoded_of(light[2]))


@wp.func
def shade(offset2: wp.float32) -> wp.float32:
    """Brightness of a shaded splat at a squared offset from its mean [standard deviations²], 1 in its middle."""
    return wp.max(1.0 - shade_slope * offset2, rim_shade)
