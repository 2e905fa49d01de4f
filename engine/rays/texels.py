# SPDX-License-Identifier: GPL-3.0-or-later
"""Clouds, instances and the order of drawing as RGBA32F texels, the one kind of array every host can read.

A float holds whole numbers exactly up to 2²⁴ only, so larger ones travel as (high, low) with low below 2¹⁶.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from ..camera import Camera
from ..errors import StippleError
from ..scene import Scene
from ..splats import SH_REST_COUNT, SplatCloud
from .interface import INSTANCE_TEXELS

FloatArray = npt.NDArray[np.float32]

SPLATS_PER_PIECE = 1 << 18  # 64 MiB of texels at degree 3
SPLAT_HEAD_TEXELS = 4  # position and opacity; rotation; scale; band 0
JACOBI_SWEEPS = 4  # what 20,000 random shears of needles needed at most, in single precision


def texels_per_splat(sh_degree: int) -> int:
    """4, 7, 10, 16 or 22 for degrees 0 to 4."""
    return SPLAT_HEAD_TEXELS + 3 * -(-SH_REST_COUNT[sh_degree] // 4)


def pack_cloud(cloud: SplatCloud, splats: slice = slice(None)) -> FloatArray:
    """(N, texels_per_splat, 4): position and opacity; rotation; scale; band 0; then coefficients of the higher bands.

    Those go four at a time: a texel with the four red values, one with green, one with blue.
    """
    position, rest = cloud.position[splats], cloud.sh_rest[splats]
    records = np.zeros((len(position), texels_per_splat(cloud.sh_degree), 4), np.float32)
    records[:, 0, :3] = position
    records[:, 0, 3] = cloud.opacity[splats]
    records[:, 1] = cloud.rotation[splats]
    records[:, 2, :3] = cloud.scale[splats]
    records[:, 3, :3] = cloud.sh_dc[splats]
    for first in range(0, rest.shape[1], 4):
        group = rest[:, first : first + 4]  # (n, up to 4, 3)
        texel = SPLAT_HEAD_TEXELS + first // 4 * 3
        records[:, texel : texel + 3, : group.shape[1]] = np.swapaxes(group, 1, 2)
    return records


def splat_pages(clouds: Sequence[SplatCloud], largest_texture: int, most_pages: int) -> Iterator[FloatArray]:
    """The records of all clouds one after the other as textures (H, W, 4), each full but the last; at least one.

    A record may lie across two pages. Packs a piece at a time, so the host holds one page and a little more. Raises
    StippleError where more than `most_pages` would be needed.
    """
    sizes = [cloud.splat_count * texels_per_splat(cloud.sh_degree) for cloud in clouds]
    page_size, total = largest_texture**2, sum(sizes)
    if total > most_pages * page_size:
        raise StippleError(
            f"rays: the captures take {total:,} texels and this graphics device's {most_pages} largest textures have "
            f"{most_pages * page_size:,}; lower the SH degree of the captures, show fewer, or choose the sorted method."
        )
    starts = np.concatenate([[0], np.cumsum(sizes, dtype=np.int64)])
    for begin in range(0, max(total, 1), page_size):
        page = np.zeros((min(total - begin, page_size), 4), np.float32)
        for cloud, start in zip(clouds, starts[:-1].tolist(), strict=True):
            _fill(page, begin - start, cloud)
        yield as_rectangle(page, largest_texture, largest_texture, "the captures")


def _fill(page: FloatArray, begin: int, cloud: SplatCloud) -> None:
    """Copies into a page what of a cloud's texels lies in it; texel `begin` of the cloud is the page's first."""
    per_splat = texels_per_splat(cloud.sh_degree)
    first, last = max(0, begin // per_splat), min(cloud.splat_count, -(-(begin + len(page)) // per_splat))
    for splat in range(first, last, SPLATS_PER_PIECE):
        texels = pack_cloud(cloud, slice(splat, min(splat + SPLATS_PER_PIECE, last))).reshape(-1, 4)
        at = splat * per_splat - begin
        skipped = max(0, -at)
        piece = texels[skipped : len(page) - at]
        page[at + skipped : at + skipped + len(piece)] = piece


def pack_instances(scene: Scene, camera: Camera) -> tuple[FloatArray, list[SplatCloud]]:
    """(I, 5, 4) and the distinct clouds in the order in which their records must follow each other.

    Per instance: the rows of camera_from_object; the eye in object space (orthographic: the forward direction) and
    the cloud's SH degree; the cloud's first texel (high, low), texels per splat, and how many Jacobi sweeps the
    linear part needs (none where it only turns, mirrors and scales evenly). Composed in float64.
    """
    clouds: list[Any] = list({id(instance.cloud): instance.cloud for instance in scene.instances}.values())
    sizes = [cloud.splat_count * texels_per_splat(cloud.sh_degree) for cloud in clouds]
    first_texel = {id(cloud): sum(sizes[:k]) for k, cloud in enumerate(clouds)}
    texels = np.zeros((len(scene.instances), INSTANCE_TEXELS, 4), np.float32)
    rotation, shift = camera.camera_from_world[:, :3], camera.camera_from_world[:, 3]
    for row, instance in zip(texels, scene.instances, strict=True):
        to_world = np.asarray(instance.world_from_object, np.float64)
        linear, translation = rotation @ to_world[:, :3], rotation @ to_world[:, 3] + shift
        inverse = np.linalg.pinv(linear)  # a flattened object still renders
        forward = inverse[:, 2] / max(float(np.linalg.norm(inverse[:, 2])), 1e-30)
        row[:3, :3], row[:3, 3] = linear, translation
        row[3, :3] = forward if camera.projection == "orthographic" else -inverse @ translation
        row[3, 3] = instance.cloud.sh_degree
        row[4, :2] = divmod(first_texel[id(instance.cloud)], 1 << 16)
        row[4, 2] = texels_per_splat(instance.cloud.sh_degree)
        row[4, 3] = 0 if keeps_angles(linear) else JACOBI_SWEEPS
    return texels, clouds


def keeps_angles(linear: npt.NDArray[np.float64]) -> bool:
    """Whether a linear map takes orthogonal vectors to orthogonal ones, as far as single precision can tell."""
    gram = linear.T @ linear
    return bool(np.abs(gram - np.trace(gram) / 3.0 * np.eye(3)).max() <= 1e-7 * np.trace(gram))


def pack_order(splat: npt.NDArray[np.integer], instance: npt.NDArray[np.integer]) -> FloatArray:
    """(N, 4): splat (high, low), instance, 0."""
    texels = np.zeros((len(splat), 4), np.float32)
    texels[:, 0], texels[:, 1] = np.divmod(splat, 1 << 16)
    texels[:, 2] = instance
    return texels


def as_rectangle(texels: FloatArray, width: int, largest_height: int, what: str) -> FloatArray:
    """(H, W, 4) with the texels row by row, W <= `width`; the end of the last row is zero.

    Raises StippleError where more rows would be needed than a texture has.
    """
    flat = texels.reshape(-1, 4)
    width = max(1, min(width, len(flat)))
    height = max(1, -(-len(flat) // width))
    if height > largest_height:
        raise StippleError(
            f"rays: {what} take {len(flat)} texels and this graphics device's largest texture has "
            f"{width * largest_height}; lower the SH degree of the captures, show fewer, or choose the sorted method."
        )
    if width * height == len(flat):
        return flat.reshape(height, width, 4)
    padded = np.zeros((height * width, 4), np.float32)
    padded[: len(flat)] = flat
    return padded.reshape(height, width, 4)
