# SPDX-License-Identifier: GPL-3.0-or-later
"""Oriented, coloured pieces of surface, and how parametric surfaces are cut into them.

Everything here is in modelling space: x right, y away from the front, z up. `build_sample` turns it at the end.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, fields

import numpy as np
import numpy.typing as npt

from .noise import FloatArray

PositionOf = Callable[[FloatArray, FloatArray], FloatArray]  # (u, v), each (N,), to points (N, 3)

UP = np.array([0, 0, 1], np.float32)
SIGMA_PER_SPACING = 0.62  # neighbours at 1.6 sigma: their opacities close the surface, texture stays crisp
THICKNESS = 0.12  # of a flat splat, relative to its smaller axis
JITTER = 0.22  # of a step between neighbours
STEP = 1e-3  # of finite differences in u and v


@dataclass
class Surfels:
    """N pieces of surface with their material, as struct-of-arrays of float32.

    - `position`, `normal`, `tangent` (N, 3): the last two are unit vectors at right angles.
    - `scale` (N, 3): standard deviation along tangent, normal × tangent, normal [units].
    - `albedo` (N, 3): diffuse reflectance, scene-linear.
    - `gloss` (N,): how much of a dielectric's reflection the surface shows, 0 matt … 1 wet.
    - `translucency` (N,): part of the diffuse light that passes through; a leaf has 0.4, a stone 0.
    - `opacity` (N,): at the mean.
    """

    position: FloatArray
    normal: FloatArray
    tangent: FloatArray
    scale: FloatArray
    albedo: FloatArray
    gloss: FloatArray
    translucency: FloatArray
    opacity: FloatArray

    def __len__(self) -> int:
        return len(self.position)

    def where(self, chosen: npt.NDArray[np.bool_] | npt.NDArray[np.intp]) -> Surfels:
        """The pieces that a mask (N,) or indices choose."""
        return Surfels(**{f.name: getattr(self, f.name)[chosen] for f in fields(self)})


def join(parts: Iterable[Surfels]) -> Surfels:
    """All parts as one, in order."""
    parts = list(parts)
    return Surfels(**{f.name: np.concatenate([getattr(part, f.name) for part in parts]) for f in fields(Surfels)})


def normalised(vectors: FloatArray) -> FloatArray:
    """Unit vectors along the last axis; a zero vector stays zero."""
    length = np.sqrt((vectors * vectors).sum(axis=-1, keepdims=True))
    return np.asarray(vectors / np.maximum(length, np.float32(1e-12)), dtype=np.float32)


def linear(code: str) -> FloatArray:
    """Scene-linear colour of an sRGB code like "c8201a"."""
    encoded = np.array([int(code[i : i + 2], 16) for i in (0, 2, 4)], np.float32) / 255
    return np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4).astype(np.float32)


def mixed(first: FloatArray, second: FloatArray, amount: FloatArray) -> FloatArray:
    """Colours (N, 3) or (3,) blended by `amount` (N,): 0 gives the first."""
    return np.asarray(first + (second - first) * amount[:, None], dtype=np.float32)


@dataclass
class Lattice:
    """Parameters (N,) of near-evenly spaced points on a surface and the parameter steps to their neighbours."""

    u: FloatArray
    v: FloatArray
    du: FloatArray
    dv: FloatArray


def lattice(
    position_of: PositionOf, spacing: float, rng: np.random.Generator, *, closed: bool = True, stretch: float = 1.0
) -> Lattice:
    """Rows of constant u about `spacing` apart, with points about `stretch * spacing` apart in each [units].

    u and v run from 0 to 1. `closed` surfaces meet themselves in v, and their rows are turned at random;
    open ones keep their borders straight. Points are moved at random by a fraction of a step.
    """
    u_probe, v_probe = np.linspace(0, 1, 49, dtype=np.float32), np.linspace(0, 1, 65, dtype=np.float32)
    grid_u, grid_v = np.meshgrid(u_probe, v_probe, indexing="ij")
    grid = position_of(grid_u.ravel(), grid_v.ravel()).reshape(49, 65, 3)
    row_length = np.linalg.norm(np.diff(grid, axis=1), axis=2).sum(axis=1)
    along = np.concatenate([[0], np.linalg.norm(np.diff(grid, axis=0), axis=2).mean(axis=1).cumsum()])
    row_count = max(2, round(float(along[-1]) / spacing))
    row_u = np.interp((np.arange(row_count) + 0.5) * along[-1] / row_count, along, u_probe)
    row_du = np.gradient(row_u) if row_count > 2 else np.full(row_count, 0.5)
    count = np.maximum(1, np.round(np.interp(row_u, u_probe, row_length) / (stretch * spacing))).astype(int)
    row = np.repeat(np.arange(row_count), count)
    index = np.arange(len(row)) - np.repeat(np.cumsum(count) - count, count)
    offset = rng.random(row_count)[row] if closed else 0.5
    dv = 1 / count[row]
    moved = rng.uniform(-JITTER, JITTER, (2, len(row))) * min(1.0, 1 / stretch**2)
    u = np.clip(row_u[row] + moved[0] * row_du[row], 0, 1)
    v = (index + offset + moved[1]) * dv
    v = v % 1.0 if closed else np.clip(v, 0, 1)
    return Lattice(*(a.astype(np.float32) for a in (u, v, row_du[row], dv)))


def surface(
    position_of: PositionOf,
    spacing: float,
    rng: np.random.Generator,
    *,
    closed: bool = True,
    flipped: bool = False,
    stretch: float = 1.0,
    thickness: float = THICKNESS,
) -> tuple[Surfels, Lattice]:
    """Flat splats that cover the surface, tangent along u, white and matt; and the parameters they have.

    The normal is dP/du × dP/dv, or its opposite where `flipped`. Sizes follow the local stretch of the
    parametrisation, so displaced and slanted places stay closed.
    """
    grid = lattice(position_of, spacing, rng, closed=closed, stretch=stretch)
    step_u, step_v = np.float32(STEP), np.float32(STEP)
    here = position_of(grid.u, grid.v)
    along_u = (position_of(grid.u + step_u, grid.v) - here) / step_u
    along_v = (position_of(grid.u, grid.v + step_v) - here) / step_v
    size_u = np.linalg.norm(along_u, axis=1) * grid.du
    normal = normalised(np.cross(along_u, along_v)) * np.float32(-1 if flipped else 1)
    tangent = normalised(along_u)
    size_v = np.abs((along_v * np.cross(normal, tangent)).sum(axis=1)) * grid.dv
    size_u = np.clip(size_u, 0.3 * spacing, 1.6 * spacing)
    size_v = np.clip(size_v, 0.3 * stretch * spacing, 1.6 * stretch * spacing)
    size = np.stack([size_u, size_v, thickness * np.minimum(size_u, size_v)], axis=1) * SIGMA_PER_SPACING
    return surfels_at(here, normal, tangent, size), grid


def surfels_at(position: FloatArray, normal: FloatArray, tangent: FloatArray, scale: FloatArray) -> Surfels:
    """White, matt, opaque surfels; `tangent` is made square to `normal`."""
    n = len(position)
    tangent = tangent - normal * (tangent * normal).sum(axis=1, keepdims=True)
    odd = np.where(np.abs(normal[:, :1]) < 0.7, [[1.0, 0, 0]], [[0, 1.0, 0]])
    spare = np.cross(normal, odd)
    tangent = np.where(np.linalg.norm(tangent, axis=1, keepdims=True) < 1e-4, spare, tangent)
    arrays = (position, normalised(normal), normalised(tangent), scale)
    zeros = np.zeros(n, np.float32)
    position, normal, tangent, scale = (np.asarray(a, np.float32) for a in arrays)
    return Surfels(
        position,
        normal,
        tangent,
        scale,
        albedo=np.ones((n, 3), np.float32),
        gloss=zeros.copy(),
        translucency=zeros.copy(),
        opacity=np.full(n, 0.97, np.float32),
    )


def strands(points: FloatArray, width: FloatArray, normal: FloatArray | None = None) -> tuple[Surfels, FloatArray]:
    """Chains of long splats along K polylines of M + 1 points, (K, M + 1, 3), `width` (K, M) at each segment [units].

    Flat ribbons that face `normal` (K, M, 3), round threads without it. Also returns how far along its strand
    each piece is, (K * M,) in 0 … 1.
    """
    start, end = points[:, :-1], points[:, 1:]
    strand_count, piece_count = start.shape[:2]
    direction = (end - start).reshape(-1, 3)
    length = np.linalg.norm(direction, axis=1)
    tangent = normalised(direction)
    across = width.reshape(-1)
    if normal is None:
        side = normalised(np.cross(tangent, np.array([0.31, -0.82, 0.47], np.float32)))
        facing, depth = side, across
    else:
        facing = normal.reshape(-1, 3)
        facing = normalised(facing - tangent * (facing * tangent).sum(axis=1, keepdims=True))
        depth = 0.2 * across
    scale = np.stack([0.55 * length, 0.5 * across, 0.5 * depth], axis=1).astype(np.float32)
    made = surfels_at(((start + end) / 2).reshape(-1, 3), facing, tangent, scale)
    fraction = np.tile((np.arange(piece_count, dtype=np.float32) + 0.5) / piece_count, strand_count)
    return made, fraction
