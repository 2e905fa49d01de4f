# SPDX-License-Identifier: GPL-3.0-or-later
"""Splats in host memory: validated arrays of finite, renderable Gaussians."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import numpy.typing as npt

from .errors import StippleError

FloatArray = npt.NDArray[np.float32]

MAX_SH_DEGREE = 4
SH_C0 = 0.28209479177387814  # Y_0^0; a splat's base colour is 0.5 + SH_C0 * sh_dc
SH_REST_COUNT = (0, 3, 8, 15, 24)  # coefficients per channel above band 0, indexed by degree
MIN_ROTATION_NORM = 1e-12  # a shorter quaternion has no direction


def sh_degree_of_rest_count(rest_count: int) -> int:
    """Degree whose bands 1 … degree hold `rest_count` coefficients per channel.

    Raises ValueError where no degree from 0 to 4 does.
    """
    return SH_REST_COUNT.index(rest_count)


Bounds = tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]
"""Smallest and largest mean along each axis [object units], two float64 arrays of shape (3,)."""


@dataclass(frozen=True, eq=False)
class SplatCloud:
    """A capture: N anisotropic Gaussians with view-dependent colour, as struct-of-arrays in object space.

    All arrays are C-contiguous float32 and *activated*: what a 3DGS file stores as a logarithm or a logit is
    already a scale or an opacity here.

    - `position` (N, 3): mean [object units].
    - `scale` (N, 3): standard deviation along each principal axis [object units], >= 0 (exp of the file's value).
    - `rotation` (N, 4): unit quaternion w, x, y, z; turns the principal axes into object space.
    - `opacity` (N,): opacity at the mean, 0 … 1 (sigmoid of the file's value).
    - `sh_dc` (N, 3): raw coefficient of band 0, in the space the capture was trained in (sRGB-encoded);
      the base colour is `0.5 + SH_C0 * sh_dc`.
    - `sh_rest` (N, C, 3): raw coefficients of bands 1 … degree, C = 0, 3, 8, 15 or 24; evaluated in object space.

    The constructor checks shapes, dtypes and that N > 0, not the values (`degenerate_mask` finds bad ones). Two clouds
    are equal only if they are the same object, so a cloud can key a cache; treat its arrays as read-only.

    Raises StippleError when an array has the wrong shape or dtype, or when there are no splats.
    """

    position: FloatArray
    scale: FloatArray
    rotation: FloatArray
    opacity: FloatArray
    sh_dc: FloatArray
    sh_rest: FloatArray
    name: str = field(default="splats")

    def __post_init__(self) -> None:
        n = len(self.position)
        if n == 0:
            raise StippleError(f"{self.name}: there are no splats to show; choose a file with at least one.")
        shapes = {"position": (n, 3), "scale": (n, 3), "rotation": (n, 4), "opacity": (n,), "sh_dc": (n, 3)}
        shapes["sh_rest"] = (n, self.sh_rest.shape[1] if self.sh_rest.ndim == 3 else -1, 3)
        for name, shape in shapes.items():
            array = getattr(self, name)
            if array.shape != shape or array.dtype != np.float32 or not array.flags.c_contiguous:
                raise StippleError(
                    f"{self.name}: {name} is {array.dtype} {array.shape}; give a contiguous float32 array, {shape}."
                )
        if self.sh_rest.shape[1] not in SH_REST_COUNT:
            raise StippleError(
                f"{self.name}: sh_rest has {self.sh_rest.shape[1]} coefficients per channel; "
                f"a complete degree has one of {SH_REST_COUNT}."
            )

    @property
    def splat_count(self) -> int:
        return len(self.position)

    @property
    def sh_degree(self) -> int:
        return sh_degree_of_rest_count(self.sh_rest.shape[1])

    @property
    def nbytes(self) -> int:
        """Host memory of the arrays [bytes]."""
        return sum(getattr(self, name).nbytes for name in ARRAY_NAMES)

    @cached_property
    def bounds(self) -> Bounds:
        """Of the means [object units]."""
        return self.position.min(axis=0).astype(np.float64), self.position.max(axis=0).astype(np.float64)


ARRAY_NAMES = ("position", "scale", "rotation", "opacity", "sh_dc", "sh_rest")


@dataclass(frozen=True, eq=False)
class SplatChunk:
    """Consecutive splats of a capture: the arrays of a `SplatCloud`, those that were not asked for without elements.

    Unlike a cloud it may hold no splats. A cloud can stand wherever a chunk is read.
    """

    splat_count: int
    sh_degree: int
    position: FloatArray
    scale: FloatArray
    rotation: FloatArray
    opacity: FloatArray
    sh_dc: FloatArray
    sh_rest: FloatArray


def full_bytes_per_splat(sh_degree: int) -> int:
    """What a splat takes in a `SplatCloud` [bytes]: 56 without harmonics, 236 with those of degree 3."""
    return 4 * (14 + 3 * SH_REST_COUNT[sh_degree])


def rest_words_of_degree(sh_degree: int) -> int:
    """32-bit words that hold a splat's quantised coefficients: 0, 3, 6, 12 or 18."""
    return -(-3 * SH_REST_COUNT[sh_degree] // 4)


def packed_bytes_per_splat(sh_degree: int) -> int:
    """What a quantised splat takes [bytes]: 21 without harmonics, 81 with those of degree 3; groups come on top."""
    colour = 4 if sh_degree == 0 else 12 + 4 + 4 * rest_words_of_degree(sh_degree)
    return 16 + 1 + colour


def degenerate_mask(
    position: FloatArray, scale: FloatArray, rotation: FloatArray, opacity: FloatArray, sh: FloatArray
) -> npt.NDArray[np.bool_]:
    """True where a splat cannot be rendered: a value that is NaN or infinite, a negative scale, a zero quaternion.

    `rotation` need not be normalised; `sh` is any (N, …) array of coefficients. A scale of zero is a flat disc
    and is fine.
    """
    bad = ~np.isfinite(position).all(axis=1)
    bad |= ~np.isfinite(scale).all(axis=1) | (scale < 0).any(axis=1)
    norm = np.sqrt(np.square(rotation, dtype=np.float32).sum(axis=1))
    bad |= ~np.isfinite(norm) | (norm < MIN_ROTATION_NORM)
    bad |= ~np.isfinite(opacity)
    bad |= ~np.isfinite(sh).all(axis=tuple(range(1, sh.ndim)))
    return bad
