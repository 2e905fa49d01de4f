# SPDX-License-Identifier: GPL-3.0-or-later
"""Clouds, instances and the order of drawing as RGBA32F texels, the one kind of array every host can read.

A float holds whole numbers exactly up to 2²⁴ only, so larger ones travel as (high, low) with low below 2¹⁶.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
import numpy.typing as npt
import warp as wp

from ..buffers import Buffers
from ..camera import Camera
from ..device import launch
from ..device_cloud import DeviceCloud, read_dc, read_rest, read_rotation, read_splat
from ..device_look import DeviceLook
from ..errors import StippleError
from ..scene import Scene
from ..splats import SH_REST_COUNT
from .interface import INSTANCE_TEXELS

wp.set_module_options({"enable_backward": False})

FloatArray = npt.NDArray[np.float32]

TEXELS_PER_PIECE = 1 << 20  # 16 MiB
SPLAT_HEAD_TEXELS = wp.constant(4)  # position and opacity; rotation; scale; band 0
JACOBI_SWEEPS = 4  # what 20,000 random shears of needles needed at most, in single precision
MOST_TEXELS = (1 << 31) - 1  # what the shaders' integers can count


def texels_per_splat(sh_degree: int) -> int:
    """4, 7, 10, 16 or 22 for degrees 0 to 4."""
    return int(SPLAT_HEAD_TEXELS) + 3 * -(-SH_REST_COUNT[sh_degree] // 4)


@wp.func
def texel_of(cloud: DeviceCloud, i: wp.int32, k: wp.int32) -> wp.vec4:
    """Texel `k` of splat `i`: position and opacity; rotation; scale; band 0; then coefficients of the higher bands.

    Those go four at a time: a texel with the four red values, one with green, one with blue.
    """
    if k == 1:
        return read_rotation(cloud, i)
    if k == 3:
        dc = read_dc(cloud, i)
        return wp.vec4(dc[0], dc[1], dc[2], 0.0)
    if k < SPLAT_HEAD_TEXELS:
        splat = read_splat(cloud, i)
        if k == 0:
            return wp.vec4(splat.position[0], splat.position[1], splat.position[2], splat.opacity)
        return wp.vec4(splat.scale[0], splat.scale[1], splat.scale[2], 0.0)
    first = (k - SPLAT_HEAD_TEXELS) / 3 * 4
    channel = (k - SPLAT_HEAD_TEXELS) % 3
    texel = wp.vec4(0.0, 0.0, 0.0, 0.0)
    for j in range(4):
        if first + j < cloud.rest_count:
            texel[j] = read_rest(cloud, i, first + j)[channel]
    return texel


@wp.kernel
def pack_texels_kernel(
    first: wp.int32, cloud: DeviceCloud, per_splat: wp.int32, begin: wp.int32, texels: wp.array(dtype=wp.vec4)
) -> None:
    t = first + wp.tid()
    texels[t] = texel_of(cloud, (begin + t) / per_splat, (begin + t) % per_splat)


def splat_pages(
    clouds: Sequence[DeviceCloud], largest_texture: int, most_pages: int, buffers: Buffers
) -> Iterator[FloatArray]:
    """The records of all clouds one after the other as textures (H, W, 4), each full but the last; at least one.

    A record may lie across two pages. Packs a piece at a time, so host and device hold one page and a little more.
    Reads the texels back. Raises StippleError where more than `most_pages` would be needed.
    """
    sizes = [cloud.splat_count * texels_per_splat(cloud.sh_degree) for cloud in clouds]
    page_size, total = largest_texture**2, sum(sizes)
    most = min(most_pages * page_size, MOST_TEXELS)
    if total > most:
        raise StippleError(
            f"rays: the captures take {total:,} texels and this graphics device can be given {most:,}; "
            "lower the SH degree of the captures, show fewer, or choose the sorted method."
        )
    starts = np.concatenate([[0], np.cumsum(sizes, dtype=np.int64)]).tolist()
    for begin in range(0, max(total, 1), page_size):
        page = np.zeros((min(total - begin, page_size), 4), np.float32)
        for cloud, start, end in zip(clouds, starts[:-1], starts[1:], strict=True):
            low, high = max(start, begin), min(end, begin + len(page))
            if low < high:
                _pack(cloud, low - start, page[low - begin : high - begin], buffers)
        yield as_rectangle(page, largest_texture, largest_texture, "the captures")


def _pack(cloud: DeviceCloud, begin: int, texels: FloatArray, buffers: Buffers) -> None:
    """Fills (N, 4) with a cloud's texels from number `begin` on."""
    per_splat = texels_per_splat(cloud.sh_degree)
    for at in range(0, len(texels), TEXELS_PER_PIECE):
        count = min(TEXELS_PER_PIECE, len(texels) - at)
        piece = buffers.array("rays_texels", wp.vec4, count)
        launch(pack_texels_kernel, count, [cloud, per_splat, begin + at, piece], buffers.device)
        texels[at : at + count] = piece.numpy()


def pack_instances(
    scene: Scene, camera: Camera, clouds: Sequence[DeviceCloud], looks: Sequence[DeviceLook]
) -> tuple[FloatArray, list[DeviceCloud]]:
    """(I, 9, 4) and the distinct clouds in the order in which their records must follow each other.

    `clouds` and `looks` run in parallel with the scene's instances. Per instance: the rows of camera_from_object; the
    eye in object space (orthographic: the forward direction) and the highest SH degree; the cloud's first texel (high,
    low), texels per splat, and how many Jacobi sweeps the linear part needs (none where it only turns, mirrors and
    scales evenly); then of the look: size, opacity (or what stands for it where another display shows), variance of the
    filter [px²] and 1 to modulate opacity (Eq. 17); the rows of its light matrix, each with 1 if it is to be used.
    Composed in float64. Crops are the order's affair.
    """
    distinct = list({id(cloud): cloud for cloud in clouds}.values())
    sizes = [cloud.splat_count * texels_per_splat(cloud.sh_degree) for cloud in distinct]
    first_texel = {id(cloud): sum(sizes[:k]) for k, cloud in enumerate(distinct)}
    texels = np.zeros((len(scene.instances), INSTANCE_TEXELS, 4), np.float32)
    rotation, shift = camera.camera_from_world[:, :3], camera.camera_from_world[:, 3]
    for row, instance, cloud, look in zip(texels, scene.instances, clouds, looks, strict=True):
        to_world = np.asarray(instance.world_from_object, np.float64)
        linear, translation = rotation @ to_world[:, :3], rotation @ to_world[:, 3] + shift
        inverse = np.linalg.pinv(linear)  # a flattened object still renders
        forward = inverse[:, 2] / max(float(np.linalg.norm(inverse[:, 2])), 1e-30)
        row[:3, :3], row[:3, 3] = linear, translation
        row[3, :3] = forward if camera.projection == "orthographic" else -inverse @ translation
        row[3, 3] = min(cloud.sh_degree, look.sh_degree)
        row[4, :2] = divmod(first_texel[id(cloud)], 1 << 16)
        row[4, 2] = texels_per_splat(cloud.sh_degree)
        row[4, 3] = jacobi_sweeps(linear)
        row[5] = look.size, look.shown_opacity or look.opacity, look.dilation_px2, look.antialiased
        row[6:, :3], row[6:, 3] = np.reshape(look.light, (3, 3)), look.graded
    return texels, distinct


def keeps_angles(linear: npt.NDArray[np.float64]) -> bool:
    """Whether a linear map takes orthogonal vectors to orthogonal ones, as far as single precision can tell."""
    gram = linear.T @ linear
    return bool(np.abs(gram - np.trace(gram) / 3.0 * np.eye(3)).max() <= 1e-7 * np.trace(gram))


def jacobi_sweeps(linear: npt.NDArray[np.float64]) -> int:
    """Sweeps of Jacobi's rotations that splats placed by a linear map need (`raygs.glsl`, `principal_axes`)."""
    return 0 if keeps_angles(linear) else JACOBI_SWEEPS


def pack_order(
    splat: npt.NDArray[np.integer], instance: npt.NDArray[np.integer], highlighted: npt.NDArray[np.bool_]
) -> FloatArray:
    """(N, 4): splat (high, low), instance, 1 to highlight it."""
    texels = np.zeros((len(splat), 4), np.float32)
    texels[:, 0], texels[:, 1] = np.divmod(splat, 1 << 16)
    texels[:, 2] = instance
    texels[:, 3] = highlighted
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
