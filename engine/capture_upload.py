# SPDX-License-Identifier: GPL-3.0-or-later
"""A capture's file into quantised arrays on the device, or those arrays from the cache file."""

from __future__ import annotations

import shutil
from collections import Counter
from collections.abc import Callable, Collection, Iterable
from contextlib import suppress
from pathlib import Path
from typing import Any

import warp as wp

from .capture_cache import BLOCK_BYTES, ArrayToStore, CacheReader, CacheUnusable, blocks_of, open_cache, write_cache
from .capture_file import CaptureFile
from .device_cloud import DeviceCloud, empty_cloud
from .errors import StippleError
from .formats.splat_source import Dropped
from .memory import gibibytes
from .progress import Progress
from .quantise import PACKING_VERSION, quantise_in_order, quantising_bytes_per_splat
from .splats import SplatChunk

GROUPS = "groups."  # how the names of the groups' arrays begin
ORDER = "place_from_source"  # what a cache holds besides: only edits read it, see `capture_order`
GROUP_ARRAYS = {
    "low": wp.vec3,
    "high": wp.vec3,
    "sigma": wp.vec3,
    "opacity": wp.float32,
    "packed_low": wp.vec3,
    "packed_span": wp.vec3,
    "packed_log_scale": wp.vec2,
    "packed_brightest": wp.float32,
}
READINGS = 2  # that `quantise` makes of the file
CACHE_SHARE = 0.15  # of the progress, for writing the cache


def bytes_to_upload(capture: CaptureFile) -> int:
    """The most that `upload_capture` takes on the device [bytes]."""
    for place in capture.places.of(capture.path):
        with suppress(CacheUnusable), open_cache(place, capture.fingerprint, PACKING_VERSION) as reader:
            return sum(array.nbytes for name, array in reader.arrays.items() if name != ORDER)
    return capture.splat_count * quantising_bytes_per_splat(capture.sh_degree)


def upload_capture(capture: CaptureFile, device: wp.Device, progress: Progress) -> DeviceCloud:
    """See `CaptureFile.upload`."""
    cloud = capture.found.device_clouds.get(device.alias)
    if cloud is None:
        cloud, capture.found.warnings = _load(capture, device, progress)
        capture.found.device_clouds[device.alias] = cloud
    return cloud


def _load(capture: CaptureFile, device: wp.Device, progress: Progress) -> tuple[DeviceCloud, tuple[str, ...]]:
    warnings: list[str] = []
    for place in capture.places.of(capture.path):
        try:
            with open_cache(place, capture.fingerprint, PACKING_VERSION) as reader:
                cloud, dropped = _from_cache(reader, capture, device, progress)
            return cloud, dropped.warnings(capture.path, capture.splat_count)
        except CacheUnusable as reason:
            if reason.damaged:
                warnings.append(f"{place}: {reason}; the capture is read again.")
    large = capture.fingerprint.file_bytes >= capture.places.smallest_bytes
    target = capture.places.to_write(capture.path) if large else None
    cloud, order, dropped = _from_file(capture, device, progress, 1.0 if target is None else 1.0 - CACHE_SHARE)
    if target is not None:
        try:
            _write(target, capture, cloud, order, dropped, progress)
        except StippleError as error:
            warnings.append(f"{error} {capture.name} will be read from its own file next time, too.")
    return cloud, (*dropped.warnings(capture.path, capture.splat_count), *warnings)


def _from_file(
    capture: CaptureFile, device: wp.Device, progress: Progress, share: float
) -> tuple[DeviceCloud, wp.array, Dropped]:
    """The cloud, where each splat of the file is in it, and what was left out."""
    source, readings = capture.source(), [Dropped() for _ in range(READINGS)]
    begun = iter(range(READINGS))

    def open_chunks(arrays: Collection[str]) -> Iterable[SplatChunk]:
        reading = next(begun)

        def report(fraction: float, text: str) -> None:
            progress(share * (reading + fraction) / READINGS, f"{text} ({reading + 1}/{READINGS})")

        return source.chunks(arrays, progress=report, dropped=readings[reading])

    cloud, order = quantise_in_order(open_chunks, capture.splat_count, capture.sh_degree, capture.name, device)
    return cloud, order, readings[-1]


def _from_cache(
    reader: CacheReader, capture: CaptureFile, device: wp.Device, progress: Progress
) -> tuple[DeviceCloud, Dropped]:
    """Raises CacheUnusable."""
    try:
        place_count, shift = int(reader.facts["place_count"]), int(reader.facts["group_shift"])
        dropped = Dropped(int(reader.facts["dropped"]), Counter(reader.facts["reasons"]))
    except (KeyError, TypeError, ValueError) as error:
        raise CacheUnusable("its facts are not what they should be") from error
    cloud = empty_cloud(place_count, capture.sh_degree)
    cloud.is_quantised = 1
    groups = cloud.groups
    groups.shift, groups.count = shift, place_count >> shift
    wanted = _array_counts(cloud, groups.count)
    shapes = {name: array.shape for name, array in reader.arrays.items()}
    if shapes.pop(ORDER, (0,)) > (place_count,) or shapes != {n: (c,) for n, (_, c) in wanted.items()}:
        raise CacheUnusable("its arrays are not what they should be")
    total, done = sum(reader.arrays[name].nbytes for name in wanted), 0
    for name, (dtype, count) in wanted.items():
        if reader.arrays[name].nbytes != count * wp.types.type_size_in_bytes(dtype):
            raise CacheUnusable(f"{name} is not of its size")

        def report(fraction_bytes: int, done: int = done) -> None:
            progress((done + fraction_bytes) / total, f"reading the cache of {capture.name}")

        owner, field = (groups, name.removeprefix(GROUPS)) if name.startswith(GROUPS) else (cloud, name)
        setattr(owner, field, read_array(reader, name, dtype, count, device, report))
        done += reader.arrays[name].nbytes
    cloud.groups = groups
    return cloud, dropped


def _array_counts(cloud: DeviceCloud, group_count: int) -> dict[str, tuple[Any, int]]:
    """Type and number of elements of each array that a quantised cloud has."""
    n = cloud.splat_count
    counts = {"packed_geometry": (wp.vec4ui, n), "packed_opacity": (wp.uint8, n)}
    if cloud.sh_degree == 0:
        counts["packed_colour"] = (wp.uint32, n)
    else:
        counts |= {"sh_dc": (wp.vec3, n), "rest_largest": (wp.float32, n)}
        counts["packed_rest"] = (wp.uint32, n * cloud.rest_words)
    return counts | {GROUPS + name: (dtype, group_count) for name, dtype in GROUP_ARRAYS.items()}


def read_array(
    reader: CacheReader, name: str, dtype: Any, count: int, device: wp.Device, report: Callable[[int], None]
) -> wp.array:
    """Straight into the device's memory on a CPU, through one pinned block on CUDA."""
    array = wp.empty(count, dtype=dtype, device=device)
    if not device.is_cuda:
        reader.read(name, memoryview(array.numpy()).cast("B"), report)
        return array
    staging = wp.empty(BLOCK_BYTES, dtype=wp.uint8, device="cpu", pinned=True)
    for index, (begin, end) in enumerate(blocks_of(reader.arrays[name].nbytes)):
        reader.read_block(name, index, memoryview(staging.numpy())[: end - begin])
        wp.copy(_as_bytes(array), staging, dest_offset=begin, count=end - begin)
        wp.synchronize_device(device)  # before the block is filled again
        report(end)
    return array


def _as_bytes(array: wp.array) -> wp.array:
    nbytes = array.size * wp.types.type_size_in_bytes(array.dtype)
    return wp.array(ptr=array.ptr, dtype=wp.uint8, shape=(nbytes,), device=array.device, copy=False)


def _write(
    place: Path, capture: CaptureFile, cloud: DeviceCloud, order: wp.array, dropped: Dropped, progress: Progress
) -> None:
    """Raises StippleError where there is no room or the file cannot be written."""
    arrays = {}
    for name, (dtype, count) in (_array_counts(cloud, cloud.groups.count) | {ORDER: (wp.int32, order.size)}).items():
        owner = cloud.groups if name.startswith(GROUPS) else cloud
        view = _as_bytes(order if name == ORDER else getattr(owner, name.removeprefix(GROUPS)))

        def fetch(begin: int, end: int, view: wp.array = view) -> memoryview:
            return memoryview(view[begin:end].numpy())

        arrays[name] = ArrayToStore(dtype.__name__, (count,), view.size, fetch)
    needed, free = sum(array.nbytes for array in arrays.values()), shutil.disk_usage(place.parent).free
    if needed > free:
        raise StippleError(
            f"{place}: there is no room for a cache file: {gibibytes(needed)} are needed and {gibibytes(free)} are "
            f"free; make room, or choose another folder with STIPPLE_CACHE."
        )
    facts = {
        "place_count": cloud.splat_count,
        "group_shift": cloud.groups.shift,
        "dropped": dropped.count,
        "reasons": dict(dropped.reasons),
    }

    def report(fraction: float) -> None:
        progress(1.0 - CACHE_SHARE * (1.0 - fraction), f"writing the cache of {capture.name}")

    write_cache(place, capture.fingerprint, PACKING_VERSION, facts, arrays, report)
