# SPDX-License-Identifier: GPL-3.0-or-later
"""Spherical harmonics: view-dependent colour, degrees 0 to 4.

Basis, signs and order are those of 3D Gaussian Splatting (Kerbl et al. 2023, doi 10.1145/3592433), degree 4 those of
gsplat. Directions point from the camera to the splat, in object space, so that a rotated object keeps its looks.
"""

from __future__ import annotations

from typing import Any

import warp as wp

wp.set_module_options({"enable_backward": False})

SH_C0 = wp.constant(0.28209479177387814)
BASIS_COUNT = 24
Basis: Any = wp.types.vector(BASIS_COUNT, wp.float32)


@wp.func
def sh_bands_1_2(b: Basis, x: wp.float32, y: wp.float32, z: wp.float32) -> Basis:
    b[0] = -0.4886025119029199 * y
    b[1] = 0.4886025119029199 * z
    b[2] = -0.4886025119029199 * x
    b[3] = 1.0925484305920792 * x * y
    b[4] = -1.0925484305920792 * y * z
    b[5] = 0.31539156525252005 * (2.0 * z * z - x * x - y * y)
    b[6] = -1.0925484305920792 * x * z
    b[7] = 0.5462742152960396 * (x * x - y * y)
    return b


@wp.func
def sh_band_3(b: Basis, x: wp.float32, y: wp.float32, z: wp.float32) -> Basis:
    xx, yy, zz = x * x, y * y, z * z
    b[8] = -0.5900435899266435 * y * (3.0 * xx - yy)
    b[9] = 2.890611442640554 * x * y * z
    b[10] = -0.4570457994644658 * y * (4.0 * zz - xx - yy)
    b[11] = 0.3731763325901154 * z * (2.0 * zz - 3.0 * xx - 3.0 * yy)
    b[12] = -0.4570457994644658 * x * (4.0 * zz - xx - yy)
    b[13] = 1.445305721320277 * z * (xx - yy)
    b[14] = -0.5900435899266435 * x * (xx - 3.0 * yy)
    return b


@wp.func
def sh_band_4(b: Basis, x: wp.float32, y: wp.float32, z: wp.float32) -> Basis:
    xx, yy, zz = x * x, y * y, z * z
    b[15] = 2.5033429417967046 * x * y * (xx - yy)
    b[16] = -1.7701307697799304 * y * z * (3.0 * xx - yy)
    b[17] = 0.9461746957575601 * x * y * (7.0 * zz - 1.0)
    b[18] = -0.6690465435572892 * y * z * (7.0 * zz - 3.0)
    b[19] = 0.10578554691520431 * (zz * (35.0 * zz - 30.0) + 3.0)
    b[20] = -0.6690465435572892 * x * z * (7.0 * zz - 3.0)
    b[21] = 0.47308734787878004 * (xx - yy) * (7.0 * zz - 1.0)
    b[22] = -1.7701307697799304 * x * z * (xx - 3.0 * yy)
    b[23] = 0.6258357354491761 * (xx * (xx - 3.0 * yy) - yy * (3.0 * xx - yy))
    return b


@wp.func
def sh_basis(degree: wp.int32, d: wp.vec3) -> Basis:
    """Y of bands 1 … `degree` along the unit vector `d`, in the order of a file's coefficients; the rest is not set."""
    b = Basis()
    if degree > 0:
        b = sh_bands_1_2(b, d[0], d[1], d[2])
    if degree > 2:
        b = sh_band_3(b, d[0], d[1], d[2])
    if degree > 3:
        b = sh_band_4(b, d[0], d[1], d[2])
    return b


@wp.func
def rest_count_of_degree(degree: wp.int32) -> wp.int32:
    """Coefficients per channel in bands 1 … `degree`."""
    return (degree + 1) * (degree + 1) - 1
