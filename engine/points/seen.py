# SPDX-License-Identifier: GPL-3.0-or-later
"""Which splats own a subpixel of the visibility buffer."""

from __future__ import annotations

import warp as wp

from ..device import launch
from ..placements import Placed
from ..staging import Staged
from .resolve import IDENTITY_MASK, NOTHING

wp.set_module_options({"enable_backward": False})


@wp.kernel
def mark_records_kernel(
    first: wp.int32,
    words: wp.array(dtype=wp.uint64),
    staged: Staged,
    instance: wp.int32,
    hits: wp.array(dtype=wp.uint8),
) -> None:
    word = words[first + wp.tid()]
    if word != NOTHING:
        j = int(word & IDENTITY_MASK)
        if staged.instance[j] == instance:
            hits[staged.splat[j]] = wp.uint8(1)


@wp.kernel
def mark_splats_kernel(
    first: wp.int32,
    words: wp.array(dtype=wp.uint64),
    placed: Placed,
    instance: wp.int32,
    hits: wp.array(dtype=wp.uint8),
) -> None:
    word = words[first + wp.tid()]
    if word != NOTHING:
        i = wp.int64(word & IDENTITY_MASK) - placed.first_splat[instance]
        if i >= wp.int64(0) and i < placed.first_splat[instance + 1] - placed.first_splat[instance]:
            hits[int(i)] = wp.uint8(1)


def mark_seen(words: wp.array, staged: Staged | None, placed: Placed, instance: int, hits: wp.array) -> None:
    """Set the byte of each splat of an instance that owns a subpixel; others stay as they are.

    `words` name records of `staged`, or where that is None splats of the scene. `hits` is uint8, one per splat of the
    instance's cloud as it lies on the device.
    """
    if staged is not None:
        launch(mark_records_kernel, words.size, [words, staged, instance, hits], words.device)
    else:
        launch(mark_splats_kernel, words.size, [words, placed, instance, hits], words.device)
