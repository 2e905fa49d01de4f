# SPDX-License-Identifier: GPL-3.0-or-later
"""Chunks of splats in, a quantised cloud on the device out, in Morton order (§3.5, 3.6 of doi 10.1145/3811272).

Reads the chunks twice, since ranges must be known before anything is packed:

1. means and scales to the device; robust centre and spread; Morton codes; one radix sort; the ranges of each group;
2. every splat packed into its place.

Takes 56 bytes per splat on the device for the first step, which are free again before the second needs its 21 to 81.
The host holds one chunk.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable

import warp as wp

from .device import launch
from .device_cloud import DeviceCloud, empty_cloud, to_device
from .errors import StippleError
from .group_bounds import bound_groups
from .groups import SplatGroups, shift_for
from .maths.packing import SMALLEST_SCALE, pack_coefficient, pack_colour, pack_geometry
from .maths.sh import SH_C0
from .morton_order import Layout, Measures, lay_out
from .splats import ARRAY_NAMES, SplatChunk, SplatCloud, packed_bytes_per_splat

wp.set_module_options({"enable_backward": False})

OpenChunks = Callable[[Collection[str]], Iterable[SplatCloud | SplatChunk]]
"""Opens the capture anew: consecutive splats in chunks, all of one SH degree, the same ones each time.

Of each chunk only the arrays that are named need be there.
"""

LARGEST_LOG_SPAN = wp.constant(18.0)  # 1 : 6.6e7 between a group's scales; what is smaller is raised
BRIGHTEST = wp.constant(4.0)  # base colours of clouds without harmonics are clipped here


PACKING_VERSION = 2  # of what the packed arrays mean and of their order; raise it with any change: caches hold them
MEASURING_BYTES = 56  # per splat, for the first step


@wp.struct
class Chunk:
    """Consecutive splats of the file on the device."""

    begin: wp.int32  # number of the first in the file
    position: wp.array(dtype=wp.vec3)
    scale: wp.array(dtype=wp.vec3)
    rotation: wp.array(dtype=wp.vec4)
    opacity: wp.array(dtype=wp.float32)
    sh_dc: wp.array(dtype=wp.vec3)
    sh_rest: wp.array(dtype=wp.float32)


@wp.kernel
def measure_kernel(first: wp.int32, chunk: Chunk, measures: Measures) -> None:
    i = first + wp.tid()
    measures.position[chunk.begin + i] = chunk.position[i]
    measures.scale[chunk.begin + i] = chunk.scale[i]
    if measures.brightness.shape[0] > 0:
        measures.brightness[chunk.begin + i] = 0.5 + SH_C0 * wp.max(chunk.sh_dc[i])


@wp.kernel
def find_ranges_kernel(
    first: wp.int32,
    measures: Measures,
    source_from_rank: wp.array(dtype=wp.int32),
    ranks: wp.array(dtype=wp.vec2i),
    groups: SplatGroups,
) -> None:
    group = first + wp.tid()
    begin, end = ranks[group][0], ranks[group][1]
    low = measures.position[source_from_rank[begin]]
    high = low
    smallest = float(1e38)
    largest = float(0.0)
    brightest = float(1.0)
    for rank in range(begin, end):
        source = source_from_rank[rank]
        low = wp.min(low, measures.position[source])
        high = wp.max(high, measures.position[source])
        smallest = wp.min(smallest, wp.min(measures.scale[source]))
        largest = wp.max(largest, wp.max(measures.scale[source]))
        if measures.brightness.shape[0] > 0:
            brightest = wp.max(brightest, measures.brightness[source])
    top = wp.log(wp.max(largest, SMALLEST_SCALE))
    bottom = wp.max(wp.log(wp.max(smallest, SMALLEST_SCALE)), top - LARGEST_LOG_SPAN)
    groups.packed_low[group] = low
    groups.packed_span[group] = high - low
    groups.packed_log_scale[group] = wp.vec2(bottom, top - bottom)
    groups.packed_brightest[group] = wp.min(brightest, BRIGHTEST)


@wp.kernel
def pack_kernel(first: wp.int32, chunk: Chunk, place_from_source: wp.array(dtype=wp.int32), cloud: DeviceCloud) -> None:
    i = first + wp.tid()
    place = place_from_source[chunk.begin + i]
    group = place >> cloud.groups.shift
    cloud.packed_geometry[place] = pack_geometry(
        chunk.position[i],
        chunk.scale[i],
        chunk.rotation[i],
        cloud.groups.packed_low[group],
        cloud.groups.packed_span[group],
        cloud.groups.packed_log_scale[group],
    )
    cloud.packed_opacity[place] = wp.uint8(wp.clamp(chunk.opacity[i], 0.0, 1.0) * 255.0 + 0.5)
    if cloud.sh_degree == 0:
        colour = wp.vec3(0.5, 0.5, 0.5) + SH_C0 * chunk.sh_dc[i]
        cloud.packed_colour[place] = pack_colour(colour, cloud.groups.packed_brightest[group])
        return
    cloud.sh_dc[place] = chunk.sh_dc[i]
    value_count = 3 * cloud.rest_count
    begin = wp.int64(i) * wp.int64(value_count)
    largest = float(0.0)
    for k in range(value_count):
        largest = wp.max(largest, wp.abs(chunk.sh_rest[begin + wp.int64(k)]))
    cloud.rest_largest[place] = largest
    for k in range(cloud.rest_words):
        word = wp.uint32(0)
        for byte in range(4):
            if 4 * k + byte < value_count:
                value = pack_coefficient(chunk.sh_rest[begin + wp.int64(4 * k + byte)], largest)
                word = word | (value << wp.uint32(8 * byte))
        cloud.packed_rest[wp.int64(place) * wp.int64(cloud.rest_words) + wp.int64(k)] = word


def quantising_bytes_per_splat(sh_degree: int) -> int:
    """The most that `quantise` takes on the device per splat [bytes]."""
    return max(MEASURING_BYTES, 4 + packed_bytes_per_splat(sh_degree))


def quantise(
    open_chunks: OpenChunks,
    splat_count: int,
    sh_degree: int,
    name: str,
    device: wp.Device,
    *,
    group_shift: int | None = None,
) -> DeviceCloud:
    """A capture's splats, quantised and in Morton order, with the bounds of their groups.

    `open_chunks` is called twice and must give the same splats of `sh_degree` both times, at most `splat_count`. The
    result does not depend on how they are cut into chunks. `group_shift` is log₂ of the splats per group where the
    cloud is to be part of a larger one. Raises StippleError where the two readings do not agree.
    """
    return quantise_in_order(open_chunks, splat_count, sh_degree, name, device, group_shift=group_shift)[0]


def place_from_source(
    open_chunks: OpenChunks, splat_count: int, sh_degree: int, name: str, device: wp.Device
) -> wp.array:
    """Where `quantise` puts each splat, as `quantise_in_order` returns it; calls `open_chunks` once.

    Equal to what `quantise` did only on the device it did it on: elsewhere a code may be rounded differently.
    """
    measures, splat_count = _measure(open_chunks, splat_count, sh_degree, name, device)
    return lay_out(measures, splat_count, device, shift_for(splat_count)).place_from_source


def quantise_in_order(
    open_chunks: OpenChunks,
    splat_count: int,
    sh_degree: int,
    name: str,
    device: wp.Device,
    *,
    group_shift: int | None = None,
) -> tuple[DeviceCloud, wp.array]:
    """As `quantise`; also where each splat of the chunks is in the cloud, (N,) int32 on the device."""
    measures, splat_count = _measure(open_chunks, splat_count, sh_degree, name, device)
    layout = lay_out(measures, splat_count, device, shift_for(splat_count) if group_shift is None else group_shift)
    cloud = empty_cloud(layout.place_count, sh_degree)
    cloud.is_quantised = 1
    cloud.groups = _ranges(measures, layout, device)
    places = layout.place_from_source
    del measures, layout  # before the packed arrays are allocated
    _allocate(cloud, device)
    begin = 0
    for part in open_chunks(ARRAY_NAMES):
        _check_chunk(part, begin, splat_count, sh_degree, name)
        inputs = [_chunk(part, begin, device), places, cloud]
        launch(pack_kernel, part.splat_count, inputs, device)
        begin += part.splat_count
    _check_total(begin, splat_count, name)
    bound_groups(cloud, device)
    return cloud, places


def _measure(
    open_chunks: OpenChunks, splat_count: int, sh_degree: int, name: str, device: wp.Device
) -> tuple[Measures, int]:
    """What the first reading keeps, and how many splats there were."""
    measures = Measures()
    measures.position = wp.empty(splat_count, dtype=wp.vec3, device=device)
    measures.scale = wp.empty(splat_count, dtype=wp.vec3, device=device)
    measures.brightness = wp.empty(splat_count if sh_degree == 0 else 0, dtype=wp.float32, device=device)
    begin = 0
    for part in open_chunks(("position", "scale", "sh_dc") if sh_degree == 0 else ("position", "scale")):
        _check_chunk(part, begin, splat_count, sh_degree, name)
        launch(measure_kernel, part.splat_count, [_chunk(part, begin, device), measures], device)
        begin += part.splat_count
    measures.position, measures.scale = measures.position[:begin], measures.scale[:begin]
    if sh_degree == 0:
        measures.brightness = measures.brightness[:begin]
    return measures, begin


def _ranges(measures: Measures, layout: Layout, device: wp.Device) -> SplatGroups:
    groups = SplatGroups()
    groups.shift, groups.count = layout.shift, layout.place_count >> layout.shift
    groups.packed_low = wp.empty(groups.count, dtype=wp.vec3, device=device)
    groups.packed_span = wp.empty(groups.count, dtype=wp.vec3, device=device)
    groups.packed_log_scale = wp.empty(groups.count, dtype=wp.vec2, device=device)
    groups.packed_brightest = wp.empty(groups.count, dtype=wp.float32, device=device)
    ranks = wp.array(layout.ranks_of_groups(), dtype=wp.vec2i, device=device)
    launch(
        find_ranges_kernel, groups.count, [measures, layout.source_from_rank, ranks, groups], device, smallest_chunk=16
    )
    return groups


def _allocate(cloud: DeviceCloud, device: wp.Device) -> None:
    """The packed arrays; all zero, so that places without a splat have opacity 0."""
    n, with_rest = cloud.splat_count, cloud.sh_degree > 0
    cloud.packed_geometry = wp.zeros(n, dtype=wp.vec4ui, device=device)
    cloud.packed_opacity = wp.zeros(n, dtype=wp.uint8, device=device)
    if with_rest:
        cloud.sh_dc = wp.zeros(n, dtype=wp.vec3, device=device)
        cloud.rest_largest = wp.zeros(n, dtype=wp.float32, device=device)
        cloud.packed_rest = wp.zeros(n * cloud.rest_words, dtype=wp.uint32, device=device)
    else:
        cloud.packed_colour = wp.zeros(n, dtype=wp.uint32, device=device)


def _chunk(part: SplatCloud | SplatChunk, begin: int, device: wp.Device) -> Chunk:
    chunk = Chunk()
    chunk.begin = begin
    chunk.position = to_device(part.position, wp.vec3, device)
    chunk.scale = to_device(part.scale, wp.vec3, device)
    chunk.rotation = to_device(part.rotation, wp.vec4, device)
    chunk.opacity = to_device(part.opacity, wp.float32, device)
    chunk.sh_dc = to_device(part.sh_dc, wp.vec3, device)
    chunk.sh_rest = to_device(part.sh_rest.reshape(-1), wp.float32, device)
    return chunk


def _check_chunk(part: SplatCloud | SplatChunk, begin: int, splat_count: int, sh_degree: int, name: str) -> None:
    if part.sh_degree != sh_degree:
        raise StippleError(f"{name}: a chunk has SH degree {part.sh_degree}, the first one {sh_degree}.")
    if begin + part.splat_count > splat_count:
        raise StippleError(f"{name}: has more than the {splat_count:,} splats it had at first; load it again.")


def _check_total(count: int, splat_count: int, name: str) -> None:
    if count != splat_count:
        raise StippleError(f"{name}: has {count:,} splats, {splat_count:,} at first; load it again.")
