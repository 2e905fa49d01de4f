# SPDX-License-Identifier: GPL-3.0-or-later
"""How one object's splats are shown: graded, cropped, displayed in another way. Changes no splat; plain values.

Grading happens in scene-linear light, splat by splat, before splats are blended (design/looks.md). A look that changes
nothing is `Look()`, and changes no bit of a picture.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import numpy.typing as npt

from .colour import Matrix, luminance_of, working_space_from_rec709
from .errors import StippleError

DISPLAYS = ("splats", "points", "ellipsoids")
SHAPES = ("box", "sphere")
KEEPS = ("inside", "outside")
MOST_CROPS = 8
IDENTITY_ROWS = ((1.0, 0.0, 0.0, 0.0), (0.0, 1.0, 0.0, 0.0), (0.0, 0.0, 1.0, 0.0))

Rgb = tuple[float, float, float]
Rows = tuple[tuple[float, ...], ...]


@dataclass(frozen=True)
class Crop:
    """A volume that decides by their means which splats are kept.

    - `world_from_crop`: rows of a 3×4 affine map, from the cube -1 … 1 or the unit sphere to the world. One that
      flattens the volume leaves nothing inside.
    - `shape` "box" or "sphere", `keep` "inside" or "outside"; what lies on the surface is inside.
    """

    world_from_crop: Rows = IDENTITY_ROWS
    shape: str = "box"
    keep: str = "inside"

    def __post_init__(self) -> None:
        if np.shape(self.world_from_crop) != (3, 4):
            raise StippleError(f"world_from_crop has shape {np.shape(self.world_from_crop)}; give three rows of four.")
        _one_of("shape", self.shape, SHAPES)
        _one_of("keep", self.keep, KEEPS)


@dataclass(frozen=True)
class Look:
    """The settings of one object; equal looks compare equal.

    Colour, in scene-linear light and the primaries of `working_space`, in this order:
    - `gain` per channel and `exposure` [stops] multiply;
    - `saturation`: 0 leaves the luminance, above 1 goes away from it;
    - `tint`: `tint_factor` (0 … 1) of the colour becomes the tint's with the same luminance.

    Splats:
    - `opacity` multiplies each splat's, which ends at 1; `size` its standard deviations.
    - `sh_degree`: highest band evaluated, None for what the render settings say; the lower one wins.
    - `antialiased`: as in `Settings`, None for what it says there.
    - `crops`: a splat is kept if it lies inside any of those that keep the inside (if there are any), and outside all
      of those that keep the outside.

    Display:
    - `display`: "splats"; "points", an opaque disc of `point_px` [px] diameter per splat; "ellipsoids", each splat's
      opaque ellipsoid of 1.5 standard deviations, darker towards its rim.
    - `least_opacity`: splats below it are not shown as points or ellipsoids.

    Raises StippleError for a value outside its range.
    """

    gain: Rgb = (1.0, 1.0, 1.0)
    exposure: float = 0.0
    saturation: float = 1.0
    tint: Rgb = (1.0, 1.0, 1.0)
    tint_factor: float = 0.0
    working_space: str = "Rec.709"
    opacity: float = 1.0
    size: float = 1.0
    sh_degree: int | None = None
    antialiased: bool | None = None
    crops: tuple[Crop, ...] = ()
    display: str = "splats"
    point_px: float = 3.0
    least_opacity: float = 0.1

    def __post_init__(self) -> None:
        _one_of("display", self.display, DISPLAYS)
        ranges = {
            "exposure": (-32.0, 32.0),
            "saturation": (0.0, 100.0),
            "tint_factor": (0.0, 1.0),
            "opacity": (0.0, 100.0),
            "size": (0.0, 1e6),
            "point_px": (0.1, 1e4),
            "least_opacity": (0.0, 1.0),
        }
        for name, (low, high) in ranges.items():
            _in_range(name, getattr(self, name), low, high)
        for name in ("gain", "tint"):
            for value in getattr(self, name):
                _in_range(name, value, 0.0, 1e6)
        if self.sh_degree is not None and not 0 <= self.sh_degree <= 4:
            raise StippleError(f"sh_degree is {self.sh_degree}; give 0 to 4.")
        if len(self.crops) > MOST_CROPS:
            raise StippleError(f"there are {len(self.crops)} crops on one object; it can have {MOST_CROPS}.")

    @property
    def visibility(self) -> tuple[object, ...]:
        """All that decides which splats can be seen, and where; colours do not."""
        return (self.opacity, self.size, self.crops, self.display, self.point_px, self.least_opacity)

    def light_matrix(self) -> Matrix | None:
        """The grading as a map of linear Rec.709 light (3, 3), float64; None where it changes nothing."""
        return _light_matrix(self.gain, self.exposure, self.saturation, self.tint, self.tint_factor, self.working_space)


@lru_cache(maxsize=64)  # an animated exposure brings another every frame
def _light_matrix(
    gain: Rgb, exposure: float, saturation: float, tint: Rgb, tint_factor: float, working_space: str
) -> Matrix | None:
    if gain == (1.0, 1.0, 1.0) and exposure == 0.0 and saturation == 1.0 and tint_factor == 0.0:
        return None
    luminance = luminance_of(working_space)
    scaled = np.diag(gain) * 2.0**exposure
    saturated = saturation * np.eye(3) + (1.0 - saturation) * luminance[None, :]
    brightness = float(luminance @ tint)
    hue = np.asarray(tint) / brightness if brightness > 0.0 else np.zeros(3)  # a black tint darkens
    tinted = (1.0 - tint_factor) * np.eye(3) + tint_factor * hue[:, None] * luminance[None, :]
    to_working = working_space_from_rec709(working_space)
    return np.asarray(np.linalg.inv(to_working) @ tinted @ saturated @ scaled @ to_working)


def crop_from_object(crop: Crop, world_from_object: npt.NDArray[np.float64]) -> Matrix:
    """(3, 4) from object space to where the volume is the cube -1 … 1 or the unit sphere; NaN for a flat one."""
    placed = np.asarray(crop.world_from_crop, np.float64)
    if not np.isfinite(placed).all() or np.linalg.matrix_rank(placed[:, :3]) < 3:
        return np.full((3, 4), np.nan)
    moved = np.asarray(world_from_object, np.float64).copy()
    moved[:, 3] -= placed[:, 3]
    return np.asarray(np.linalg.solve(placed[:, :3], moved))


def _one_of(name: str, value: str, choices: tuple[str, ...]) -> None:
    if value not in choices:
        raise StippleError(f"{name} is {value!r}; choose one of {', '.join(choices)}.")


def _in_range(name: str, value: float, low: float, high: float) -> None:
    if not low <= value <= high:
        raise StippleError(f"{name} is {value}; give a value from {low} to {high}.")
