# SPDX-License-Identifier: GPL-3.0-or-later
"""Radiance that depends on the view, as spherical harmonics in the 3DGS convention.

A splat's colour is 0.5 + sum over k of basis_k(d) · sh_k, with d the unit direction from the camera to the splat in
object space and the real basis in the order and with the signs of INRIA's code (Kerbl et al. 2023).
"""

from __future__ import annotations

import numpy as np

from ...engine.splats import SH_C0
from .lighting import SUN_RADIANCE, Light, sky_radiance
from .noise import FloatArray
from .surfels import Surfels

VIEW_COUNT = 48
NORMAL_GROUPS = 96
EXPOSURE = 1.0
SATURATION = 0.92


def sh_basis(direction: FloatArray) -> FloatArray:
    """The 16 real basis functions of degree 3 at unit directions (N, 3): (N, 16)."""
    x, y, z = direction.T
    xx, yy, zz = x * x, y * y, z * z
    rows = [np.full_like(x, 0.28209479177387814)]
    rows += [-0.4886025119029199 * y, 0.4886025119029199 * z, -0.4886025119029199 * x]
    rows += [1.0925484305920792 * x * y, -1.0925484305920792 * y * z, 0.31539156525252005 * (2 * zz - xx - yy)]
    rows += [-1.0925484305920792 * x * z, 0.5462742152960396 * (xx - yy)]
    rows += [-0.5900435899266435 * y * (3 * xx - yy), 2.890611442640554 * x * y * z]
    rows += [-0.4570457994644658 * y * (4 * zz - xx - yy), 0.3731763325901154 * z * (2 * zz - 3 * xx - 3 * yy)]
    rows += [-0.4570457994644658 * x * (4 * zz - xx - yy), 1.445305721320277 * z * (xx - yy)]
    rows += [-0.5900435899266435 * x * (xx - 3 * yy)]
    return np.stack(rows, axis=1).astype(np.float32)


def display_encoded(radiance: FloatArray) -> FloatArray:
    """Scene-linear radiance to sRGB-encoded display values, slightly desaturated, with a filmic curve.

    The curve is Narkowicz's fit to ACES (2015). Colours are (…, 3).
    """
    x = np.maximum(radiance * np.float32(EXPOSURE), 0)
    grey = x @ np.array([0.2126, 0.7152, 0.0722], np.float32)
    x = grey[..., None] + np.float32(SATURATION) * (x - grey[..., None])
    shown = np.clip(x * (2.51 * x + 0.03) / (x * (2.43 * x + 0.59) + 0.14), 0, 1)
    return np.where(shown <= 0.0031308, 12.92 * shown, 1.055 * np.power(shown, np.float32(1 / 2.4)) - 0.055)


def view_directions() -> FloatArray:
    """Unit directions from the subject to the cameras of a usual capture, (VIEW_COUNT, 3), z up.

    Mostly from slightly below the horizon to 65 degrees above it, a few from the top.
    """
    k = np.arange(VIEW_COUNT)
    up, angle = -0.05 + 1.03 * ((k + 0.5) / VIEW_COUNT) ** 1.15, 2.39996 * k
    flat = np.sqrt(1 - up * up)
    return np.stack([flat * np.cos(angle), flat * np.sin(angle), up], axis=1).astype(np.float32)


def fitted_sh(made: Surfels, light: Light, sun_direction: FloatArray, object_from_model: FloatArray) -> FloatArray:
    """SH coefficients (N, 16, 3) of the encoded radiance minus 0.5, by weighted least squares over the views.

    Matt surfels look the same from everywhere and need no fit. Surfels of similar normal share one weighting of the
    views, in which those that cannot see them count little: the fit spends its 16 coefficients on what a camera sees.
    """
    to_camera = view_directions()
    basis = sh_basis(-to_camera @ object_from_model.T)
    centres = _sphere(NORMAL_GROUPS)
    group = (made.normal @ centres.T).argmax(axis=1)
    sh = np.zeros((len(made), 16, 3), np.float32)
    sh[:, 0] = (display_encoded(light.diffuse) - 0.5) / SH_C0
    two_sided = made.translucency > 0.2
    for which in range(NORMAL_GROUPS):
        for sided in (False, True):
            members = np.flatnonzero((group == which) & (two_sided == sided) & (made.gloss > 0))
            if len(members) == 0:
                continue
            cosine = to_camera @ centres[which]
            weight = 0.03 + np.clip(np.abs(cosine) if sided else cosine + 0.25, 0, 1)
            weighted = basis * weight[:, None]
            ridge = np.diag([1e-4] + [0.15] * 3 + [0.35] * 5 + [0.6] * 7)
            solve = np.linalg.solve(weighted.T @ basis + ridge, weighted.T).astype(np.float32)
            colour = display_encoded(_radiance(made.where(members), light, members, to_camera, sun_direction)) - 0.5
            sh[members] = np.tensordot(colour, solve, axes=(1, 1)).transpose(0, 2, 1)
    return sh


def _radiance(
    made: Surfels, light: Light, members: np.typing.NDArray[np.intp], to_camera: FloatArray, sun_direction: FloatArray
) -> FloatArray:
    """Diffuse and reflected radiance towards each view, (n, VIEW_COUNT, 3)."""
    cosine = np.abs(made.normal @ to_camera.T)
    side = np.where(made.normal @ to_camera.T < 0, np.float32(-1), np.float32(1))
    # Mirrored about the normal that faces the camera: only its height and its angle to the sun are needed.
    upward = 2 * cosine * side * made.normal[:, 2:] - to_camera[:, 2]
    towards_sun = 2 * cosine * side * (made.normal @ sun_direction)[:, None] - to_camera @ sun_direction
    gloss = made.gloss[:, None]
    grazing = (1 - cosine) ** 5
    sharpness = 6 + 34 * gloss
    sun_lobe = sharpness / np.float32(2 * np.pi) * np.exp(sharpness * (towards_sun - 1))
    sun = (sun_lobe * gloss * (0.06 + 0.4 * grazing) * light.sun[members][:, None])[..., None] * SUN_RADIANCE
    sky = sky_radiance(upward)
    sky = sky * (gloss * (0.02 + 0.3 * grazing) * light.open_sky[members][:, None] ** 1.5)[..., None]
    return np.asarray(light.diffuse[members][:, None] + sun + sky, np.float32)


def _sphere(count: int) -> FloatArray:
    """`count` unit vectors spread evenly over the sphere (Fibonacci lattice)."""
    k = np.arange(count)
    up, angle = 1 - 2 * (k + 0.5) / count, 2.39996 * k
    flat = np.sqrt(1 - up * up)
    return np.stack([flat * np.cos(angle), flat * np.sin(angle), up], axis=1).astype(np.float32)
