# SPDX-License-Identifier: GPL-3.0-or-later
"""Where each splat of a capture's file lies on the device, for quantised splats are in Morton order.

Rendering never needs it, so it is not on the device but while a capture is edited (4 bytes per splat). The cache file
holds it; where there is none, it is worked out as `quantise` did it, by reading the file once.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable
from contextlib import suppress

import warp as wp

from .buffers import allocate
from .capture_cache import CacheUnusable, open_cache
from .capture_file import CaptureFile
from .capture_upload import ORDER, read_array
from .device import free_bytes, launch
from .errors import DeviceError, StippleError
from .memory import gibibytes
from .progress import Progress
from .quantise import MEASURING_BYTES, PACKING_VERSION, place_from_source
from .splats import SplatChunk

wp.set_module_options({"enable_backward": False})


@wp.kernel
def move_to_places_kernel(
    first: wp.int32,
    words: wp.array(dtype=wp.uint32),
    place_from_source: wp.array(dtype=wp.int32),
    placed: wp.array(dtype=wp.uint32),
) -> None:
    i = first + wp.tid()
    placed[place_from_source[i]] = words[i]


def order_of(capture: CaptureFile, device: wp.Device, progress: Progress) -> wp.array:
    """(N,) int32 on the device: the place of each splat of the file, those that cannot be rendered left out.

    Uploads the capture if it is not there yet; shared by all who ask, as long as one holds it. Raises StippleError
    where the file cannot be read or memory runs out, and lets `Cancelled` through.
    """
    order = capture.found.orders.get(device.alias)
    if order is None:
        cloud = capture.upload(device, progress)
        order = _from_cache(capture, cloud.splat_count, device, progress)
        if order is None:
            order = _from_file(capture, device, progress)
        capture.found.orders[device.alias] = order
    return order


def in_places(words: wp.array, capture: CaptureFile, progress: Progress) -> wp.array:
    """Flags (N,) uint32 of the file's splats as flags of the cloud on the words' device; fill-ups have none."""
    device = words.device
    order, cloud = order_of(capture, device, progress), capture.upload(device, progress)
    placed = allocate(device, wp.uint32, cloud.splat_count, f"the flags of {capture.name}")
    placed.zero_()
    launch(move_to_places_kernel, words.size, [words, order, placed], device)
    return placed


def _from_cache(capture: CaptureFile, place_count: int, device: wp.Device, progress: Progress) -> wp.array | None:
    """None where there is no cache. A damaged one may be of another device, whose order this one might not find."""

    def report(done: int) -> None:
        progress(done / (4 * capture.splat_count), f"reading the order of {capture.name}")

    for place in capture.places.of(capture.path):
        with suppress(CacheUnusable), open_cache(place, capture.fingerprint, PACKING_VERSION) as reader:
            stored = reader.arrays.get(ORDER)
            if stored is None or reader.facts.get("place_count") != place_count:
                continue
            try:
                if stored.nbytes != 4 * stored.shape[0]:
                    raise CacheUnusable(f"{ORDER} is not of its size")
                return read_array(reader, ORDER, wp.int32, stored.shape[0], device, report)
            except CacheUnusable as reason:
                raise StippleError(f"{place}: {reason}; delete this cache file and open the capture again.") from reason
    return None


def _from_file(capture: CaptureFile, device: wp.Device, progress: Progress) -> wp.array:
    needed, free = capture.splat_count * MEASURING_BYTES, free_bytes(device)
    if needed > free:
        raise DeviceError(
            f"{capture.name}: {gibibytes(needed)} are needed on {device.alias} to edit it and {gibibytes(free)} are "
            "free; let it have a cache file, or free some memory."
        )
    source = capture.source()

    def open_chunks(arrays: Collection[str]) -> Iterable[SplatChunk]:
        return source.chunks(
            arrays, progress=lambda fraction, _: progress(fraction, f"finding the order of {capture.name}")
        )

    return place_from_source(open_chunks, capture.splat_count, capture.sh_degree, capture.name, device)
