# SPDX-License-Identifier: GPL-3.0-or-later
"""Colour: between the blend space (sRGB-encoded), scene-linear light and 8-bit files.

Captures are trained by blending sRGB-encoded colours, so the film sums in that space. Everything here happens once
per finished picture. Colours are premultiplied unless a name says straight.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cache

import numpy as np
import numpy.typing as npt

from .errors import StippleError

Array = npt.NDArray[np.floating]
Matrix = npt.NDArray[np.float64]
Chromaticity = tuple[float, float]  # CIE 1931 x, y

ALPHA_EMPTY = 1e-10  # coverage below this is none: a ratio of two such numbers means nothing
ENCODED_KNEE = 0.04045  # where sRGB's two pieces meet, encoded (IEC 61966-2-1)
LINEAR_KNEE = 0.0031308


MOST_THREADS = 8  # more would wait for memory
ROWS_PER_BLOCK = 16  # of 1920 float32 pixels: 0.5 MB, which stays in a core's cache


@dataclass(frozen=True)
class Primaries:
    """An RGB space by its primaries and white point, each CIE 1931 (x, y)."""

    red: Chromaticity
    green: Chromaticity
    blue: Chromaticity
    white: Chromaticity


# Rec.709: ITU-R BT.709-6; Rec.2020: ITU-R BT.2020-2; ACEScg: Academy S-2014-004 (AP1, the ACES white near D60).
WORKING_SPACES = {
    "Rec.709": Primaries((0.64, 0.33), (0.30, 0.60), (0.15, 0.06), (0.3127, 0.3290)),
    "Rec.2020": Primaries((0.708, 0.292), (0.170, 0.797), (0.131, 0.046), (0.3127, 0.3290)),
    "ACEScg": Primaries((0.713, 0.293), (0.165, 0.830), (0.128, 0.044), (0.32168, 0.33767)),
}

# Cone responses of the Bradford transform (Lam 1985, as in ICC.1:2022 annex E), rows rho, gamma, beta.
BRADFORD = np.array([[0.8951, 0.2664, -0.1614], [-0.7502, 1.7135, 0.0367], [0.0389, -0.0685, 1.0296]])


def linear_from_srgb(encoded: Array) -> Array:
    """sRGB-encoded values to linear ones, element by element; keeps shape and floating dtype.

    Values above 1 follow the same power law, so highlights survive. Negative values are mirrored,
    f(−x) = −f(x): the map stays one-to-one and the round trip exact. (IEC 61966-2-1 defines 0 … 1 only.)
    """
    size = np.abs(encoded)
    with np.errstate(under="ignore"):
        line = size / 12.92
    curve = np.asarray(_to_the_2_4((size + 0.055) / 1.055))
    np.copyto(curve, line, where=size <= ENCODED_KNEE)
    return np.copysign(curve, encoded, out=curve)


def srgb_from_linear(linear: Array) -> Array:
    """Linear values to sRGB-encoded ones: the inverse of `linear_from_srgb`, extended the same way."""
    size = np.abs(linear)
    curve = 1.055 * size ** (1.0 / 2.4) - 0.055
    return np.copysign(np.where(size <= LINEAR_KNEE, size * 12.92, curve), linear)


def straight_from_premultiplied(rgba: Array) -> Array:
    """Divides (…, 4) colour by alpha; where alpha is below 1e-10 nothing is covered and the colour is 0."""
    alpha = rgba[..., 3]
    straight = rgba.copy()
    if (alpha == 1).all():  # an opaque film, the usual one
        return straight
    covered = alpha > ALPHA_EMPTY
    divisor = np.where(covered, alpha, 1)
    for channel in range(3):  # channel by channel: NumPy broadcasts over a last axis of 3 ten times slower
        straight[..., channel] = np.where(covered, rgba[..., channel] / divisor, 0)
    return straight


def premultiplied_from_straight(rgba: Array) -> Array:
    """Multiplies (…, 4) colour by alpha."""
    premultiplied = rgba.copy()
    if not (rgba[..., 3] == 1).all():
        for channel in range(3):
            premultiplied[..., channel] *= rgba[..., 3]
    return premultiplied


def scene_linear_from_display(rgba: Array, working_space: str = "Rec.709") -> Array:
    """Premultiplied sRGB-encoded (…, 4) to premultiplied scene-linear light in `working_space`; same dtype.

    The transfer function is not linear, so it must see the straight colour: divide by alpha, linearise, multiply
    again. Alpha is coverage and stays as it is. Raises StippleError for an unknown working space.
    """
    matrix = working_space_from_rec709(working_space)

    def convert(block: Array) -> Array:
        light = linear_from_srgb(straight_from_premultiplied(block))  # alpha too: what is contiguous is faster
        if working_space != "Rec.709":
            light[..., :3] = light[..., :3] @ matrix.T.astype(rgba.dtype)
        light[..., 3] = block[..., 3]
        return premultiplied_from_straight(light)

    return _by_rows(convert, rgba)


def display_from_scene_linear(rgba: Array, working_space: str = "Rec.709") -> Array:
    """The inverse of `scene_linear_from_display`; colour under no coverage becomes 0."""
    matrix = np.linalg.inv(working_space_from_rec709(working_space))
    straight = straight_from_premultiplied(rgba)
    light = straight[..., :3]
    if working_space != "Rec.709":
        light = light @ matrix.T.astype(rgba.dtype)
    straight[..., :3] = srgb_from_linear(light)
    return premultiplied_from_straight(straight)


def bytes_from_display(rgba: Array) -> npt.NDArray[np.uint8]:
    """Premultiplied sRGB-encoded (…, 4) to straight-alpha 8-bit sRGB (…, 4), as PNG stores it.

    Clamps to 0 … 1 after dividing by alpha, then rounds to the nearest of the 256 levels.
    """
    return np.rint(np.clip(straight_from_premultiplied(rgba), 0, 1) * 255).astype(np.uint8)


def display_from_bytes(pixels: npt.NDArray[np.uint8]) -> npt.NDArray[np.float32]:
    """Straight-alpha 8-bit sRGB (…, 4) to premultiplied sRGB-encoded float32."""
    return premultiplied_from_straight(pixels.astype(np.float32) / np.float32(255)).astype(np.float32)


def xyz_from_rgb(space: Primaries) -> Matrix:
    """Linear RGB to CIE XYZ (3, 3), white at Y = 1 (SMPTE RP 177).

    Each primary's XYZ direction is known from its chromaticity; its length follows from R = G = B = 1 being white.
    """
    directions = np.stack([_xyz_of(space.red), _xyz_of(space.green), _xyz_of(space.blue)], axis=1)
    return directions * np.linalg.solve(directions, _xyz_of(space.white))


@cache
def working_space_from_rec709(working_space: str) -> Matrix:
    """Linear Rec.709 to the linear working space (3, 3), float64, read-only; white maps to white.

    `working_space` is one of Rec.709, Rec.2020 and ACEScg. Where the white points differ the light is adapted by
    Bradford. Raises StippleError for another name.
    """
    if working_space not in WORKING_SPACES:
        raise StippleError(f"working space is {working_space!r}; choose one of {', '.join(WORKING_SPACES)}.")
    source, target = WORKING_SPACES["Rec.709"], WORKING_SPACES[working_space]
    adapted = _bradford(source.white, target.white) @ xyz_from_rgb(source)
    matrix = np.linalg.solve(xyz_from_rgb(target), adapted)
    matrix.flags.writeable = False
    return matrix


def _to_the_2_4(positive: Array) -> Array:
    """x^2.4. In float32 as x² exp(0.4 ln x), which NumPy computes in vectors: four times faster, off by 3 ulp at most.

    (0.4 of the logarithm and not 2.4, or its rounding would show sixfold.)
    """
    if positive.dtype != np.float32:
        return positive**2.4
    power = np.log(positive)
    power *= np.float32(0.4)
    np.exp(power, out=power)
    power *= positive
    power *= positive
    return power


@cache
def luminance_of(working_space: str) -> Matrix:
    """Weights (3,) of linear red, green and blue in the luminance Y, white's being 1; float64, read-only."""
    working_space_from_rec709(working_space)  # raises for an unknown name
    weights = xyz_from_rgb(WORKING_SPACES[working_space])[1].copy()
    weights.flags.writeable = False
    return weights


def _by_rows(convert: Callable[[Array], Array], rgba: Array) -> Array:
    """`convert` on blocks of rows of a picture, on all cores; the result is contiguous.

    Intermediate arrays of a block stay in the cache (3× at 1080p, one Xeon core).
    """
    if rgba.ndim < 3 or len(rgba) <= ROWS_PER_BLOCK:
        return convert(rgba)
    result = np.empty(rgba.shape, rgba.dtype)

    def convert_block(first: int) -> None:
        result[first : first + ROWS_PER_BLOCK] = convert(rgba[first : first + ROWS_PER_BLOCK])

    with ThreadPoolExecutor(min(MOST_THREADS, os.cpu_count() or 1), thread_name_prefix="stipple-colour") as pool:
        list(pool.map(convert_block, range(0, len(rgba), ROWS_PER_BLOCK)))  # raises the first failure
    return result


def _xyz_of(chromaticity: Chromaticity) -> Matrix:
    x, y = chromaticity
    return np.array([x / y, 1.0, (1.0 - x - y) / y])


def _bradford(source_white: Chromaticity, target_white: Chromaticity) -> Matrix:
    """XYZ seen under one white to the XYZ that looks the same under another (3, 3)."""
    gain = (BRADFORD @ _xyz_of(target_white)) / (BRADFORD @ _xyz_of(source_white))
    return np.linalg.solve(BRADFORD, gain[:, None] * BRADFORD)
