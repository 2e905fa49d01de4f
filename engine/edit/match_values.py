# SPDX-License-Identifier: GPL-3.0-or-later
"""Find splats by what they are: colour, opacity, size."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import warp as wp

from ..device import launch
from ..errors import StippleError
from ..splats import SH_C0
from .affine import checked
from .editable_cloud import EditableCloud
from .mask import Mask, mask_from_hits

wp.set_module_options({"enable_backward": False})

SH_C0_F = wp.constant(SH_C0)


@wp.func
def linear_from_srgb(c: wp.float32) -> wp.float32:
    """The sRGB curve, c >= 0."""
    if c <= 0.04045:
        return c / 12.92
    return wp.pow((c + 0.055) / 1.055, 2.4)


@wp.func
def oklab(srgb: wp.vec3) -> wp.vec3:
    """Lightness and two opponent colours, in which distance is what the eye sees (Ottosson 2020); sRGB-encoded in."""
    r = linear_from_srgb(wp.max(srgb[0], 0.0))
    g = linear_from_srgb(wp.max(srgb[1], 0.0))
    b = linear_from_srgb(wp.max(srgb[2], 0.0))
    third = 1.0 / 3.0
    l_ = wp.pow(0.4122214708 * r + 0.5363325363 * g + 0.0514459929 * b, third)
    m = wp.pow(0.2119034982 * r + 0.6806995451 * g + 0.1073969566 * b, third)
    s = wp.pow(0.0883024619 * r + 0.2817188376 * g + 0.6299787005 * b, third)
    return wp.vec3(
        0.2104542553 * l_ + 0.7936177850 * m - 0.0040720468 * s,
        1.9779984951 * l_ - 2.4285922050 * m + 0.4505937099 * s,
        0.0259040371 * l_ + 0.7827717662 * m - 0.8086757660 * s,
    )


@wp.kernel
def match_colour_kernel(
    first: wp.int32,
    sh_dc: wp.array(dtype=wp.vec3),
    wanted_srgb: wp.vec3,
    tolerance: wp.float32,
    lightness_weight: wp.float32,
    hits: wp.array(dtype=wp.uint8),
) -> None:
    i = first + wp.tid()
    away = oklab(wp.vec3(0.5, 0.5, 0.5) + SH_C0_F * sh_dc[i]) - oklab(wanted_srgb)
    away[0] = away[0] * lightness_weight
    hits[i] = wp.uint8(wp.where(wp.dot(away, away) <= tolerance * tolerance, 1, 0))


@wp.kernel
def match_range_kernel(
    first: wp.int32,
    values: wp.array(dtype=wp.float32),
    low: wp.float32,
    high: wp.float32,
    hits: wp.array(dtype=wp.uint8),
) -> None:
    i = first + wp.tid()
    hits[i] = wp.uint8(wp.where(values[i] >= low and values[i] <= high, 1, 0))


@wp.kernel
def match_size_kernel(
    first: wp.int32,
    scale: wp.array(dtype=wp.vec3),
    rotation: wp.array(dtype=wp.vec4),
    world_from_object: wp.mat33,
    low: wp.float32,
    high: wp.float32,
    hits: wp.array(dtype=wp.uint8),
) -> None:
    i = first + wp.tid()
    q = rotation[i]
    axes = world_from_object * wp.quat_to_matrix(wp.quat(q[1], q[2], q[3], q[0]))
    size = float(0.0)
    for k in range(3):
        size = wp.max(size, scale[i][k] * wp.length(wp.vec3(axes[0, k], axes[1, k], axes[2, k])))
    hits[i] = wp.uint8(wp.where(size >= low and size <= high, 1, 0))


def match_colour(
    cloud: EditableCloud, colour: npt.ArrayLike, tolerance: float = 0.1, lightness_weight: float = 1.0
) -> Mask:
    """Splats whose base colour looks like `colour` (3,), sRGB-encoded 0 … 1.

    `tolerance` is a distance in Oklab: 0.02 is just seen, 0.1 a shade, 0.3 another colour. With a `lightness_weight` of
    0 light and dark shades of a hue match alike. Raises StippleError for a negative tolerance.
    """
    wanted = np.asarray(colour, np.float64)
    if wanted.shape != (3,) or not np.isfinite(wanted).all() or not tolerance >= 0 or not lightness_weight >= 0:
        raise StippleError(f"colour {wanted}, tolerance {tolerance}: give three finite values and nothing below 0.")
    hits = cloud.hits()
    inputs = [cloud.array("sh_dc"), wp.vec3(*wanted), tolerance, lightness_weight, hits]
    launch(match_colour_kernel, cloud.splat_count, inputs, cloud.device)
    return mask_from_hits(hits, cloud.splat_count)


def match_opacity(cloud: EditableCloud, low: float = 0.0, high: float = 1.0) -> Mask:
    """Splats whose opacity is from `low` to `high`. Raises StippleError where `low` is above `high`."""
    _check_range("opacity", low, high)
    hits = cloud.hits()
    launch(match_range_kernel, cloud.splat_count, [cloud.array("opacity"), low, high, hits], cloud.device)
    return mask_from_hits(hits, cloud.splat_count)


def match_size(
    cloud: EditableCloud, low: float, high: float = np.inf, world_from_object: npt.ArrayLike | None = None
) -> Mask:
    """Splats whose longest principal axis has a standard deviation from `low` to `high` [world units].

    Raises StippleError where `low` is above `high`.
    """
    _check_range("size", low, high)
    linear = checked(world_from_object, "world_from_object")[:, :3]
    hits = cloud.hits()
    inputs = [cloud.array("scale"), cloud.array("rotation"), wp.mat33(*linear.ravel()), low, high, hits]
    launch(match_size_kernel, cloud.splat_count, inputs, cloud.device)
    return mask_from_hits(hits, cloud.splat_count)


def _check_range(what: str, low: float, high: float) -> None:
    if not low <= high:
        raise StippleError(f"{what} range: {low} to {high} holds nothing; give the smaller value first.")
