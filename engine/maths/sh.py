# SPDX-License-Identifier: GPL-3.0-or-later
"""Spherical harmonics: view-dependent colour, degrees 0 to 4.

Basis, signs and order are those of 3D Gaussian Splatting (Kerbl et al. 2023, doi 10.1145/3592433), degree 4 those of
gsplat. Directions point from the camera to the splat, in object space, so that a rotated object keeps its looks.
"""

from __future__ import annotations

import warp as wp

wp.set_module_options({"enable_backward": False})


@wp.func
def sh_bands_1_2(rest: wp.array(dtype=wp.vec3), i: wp.int32, degree: wp.int32, d: wp.vec3) -> wp.vec3:
    x, y, z = d[0], d[1], d[2]
    colour = 0.4886025119029199 * (z * rest[i + 1] - y * rest[i] - x * rest[i + 2])
    if degree > 1:
        colour += (1.0925484305920792 * x * y) * rest[i + 3]
        colour += (-1.0925484305920792 * y * z) * rest[i + 4]
        colour += (0.31539156525252005 * (2.0 * z * z - x * x - y * y)) * rest[i + 5]
        colour += (-1.0925484305920792 * x * z) * rest[i + 6]
        colour += (0.5462742152960396 * (x * x - y * y)) * rest[i + 7]
    return colour


@wp.func
def sh_band_3(rest: wp.array(dtype=wp.vec3), i: wp.int32, d: wp.vec3) -> wp.vec3:
    x, y, z = d[0], d[1], d[2]
    xx, yy, zz = x * x, y * y, z * z
    colour = (-0.5900435899266435 * y * (3.0 * xx - yy)) * rest[i + 8]
    colour += (2.890611442640554 * x * y * z) * rest[i + 9]
    colour += (-0.4570457994644658 * y * (4.0 * zz - xx - yy)) * rest[i + 10]
    colour += (0.3731763325901154 * z * (2.0 * zz - 3.0 * xx - 3.0 * yy)) * rest[i + 11]
    colour += (-0.4570457994644658 * x * (4.0 * zz - xx - yy)) * rest[i + 12]
    colour += (1.445305721320277 * z * (xx - yy)) * rest[i + 13]
    colour += (-0.5900435899266435 * x * (xx - 3.0 * yy)) * rest[i + 14]
    return colour


@wp.func
def sh_band_4(rest: wp.array(dtype=wp.vec3), i: wp.int32, d: wp.vec3) -> wp.vec3:
    x, y, z = d[0], d[1], d[2]
    xx, yy, zz = x * x, y * y, z * z
    colour = (2.5033429417967046 * x * y * (xx - yy)) * rest[i + 15]
    colour += (-1.7701307697799304 * y * z * (3.0 * xx - yy)) * rest[i + 16]
    colour += (0.9461746957575601 * x * y * (7.0 * zz - 1.0)) * rest[i + 17]
    colour += (-0.6690465435572892 * y * z * (7.0 * zz - 3.0)) * rest[i + 18]
    colour += (0.10578554691520431 * (zz * (35.0 * zz - 30.0) + 3.0)) * rest[i + 19]
    colour += (-0.6690465435572892 * x * z * (7.0 * zz - 3.0)) * rest[i + 20]
    colour += (0.47308734787878004 * (xx - yy) * (7.0 * zz - 1.0)) * rest[i + 21]
    colour += (-1.7701307697799304 * x * z * (xx - 3.0 * yy)) * rest[i + 22]
    colour += (0.6258357354491761 * (xx * (xx - 3.0 * yy) - yy * (3.0 * xx - yy))) * rest[i + 23]
    return colour


@wp.func
def sh_colour(
    dc: wp.vec3, rest: wp.array(dtype=wp.vec3), first_rest: wp.int64, degree: wp.int32, d: wp.vec3
) -> wp.vec3:
    """Colour max(0, ½ + Σ c Y(d)) in the space the capture was trained in (sRGB-encoded); may exceed 1.

    `rest` holds coefficients of bands 1 … of all splats, this one's from `first_rest`; `degree` is the highest band
    evaluated; `d` is a unit vector.
    """
    colour = wp.vec3(0.5, 0.5, 0.5) + 0.28209479177387814 * dc
    i = int(first_rest)
    if degree > 0:
        colour += sh_bands_1_2(rest, i, degree, d)
    if degree > 2:
        colour += sh_band_3(rest, i, d)
    if degree > 3:
        colour += sh_band_4(rest, i, d)
    return wp.vec3(wp.max(colour[0], 0.0), wp.max(colour[1], 0.0), wp.max(colour[2], 0.0))
