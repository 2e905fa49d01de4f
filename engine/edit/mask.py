# SPDX-License-Identifier: GPL-3.0-or-later
"""A set of splats as one bit each: what selections find, what flags become and what history keeps of both."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import warp as wp

from ..buffers import allocate
from ..device import launch
from ..errors import StippleError

wp.set_module_options({"enable_backward": False})

EDIT_LESS = "edit fewer splats at a time, lower the undo memory limit, or choose another device"

AND, OR, XOR, AND_NOT = 0, 1, 2, 3


@wp.kernel
def pack_kernel(
    first: wp.int32, hits: wp.array(dtype=wp.uint8), splat_count: wp.int32, words: wp.array(dtype=wp.uint32)
) -> None:
    w = first + wp.tid()
    bits = wp.uint32(0)
    for k in range(wp.min(32, splat_count - 32 * w)):
        bits |= wp.where(hits[32 * w + k] != wp.uint8(0), wp.uint32(1) << wp.uint32(k), wp.uint32(0))
    words[w] = bits


@wp.kernel
def match_state_kernel(
    first: wp.int32,
    state: wp.array(dtype=wp.uint32),
    splat_count: wp.int32,
    tested: wp.uint32,
    wanted: wp.uint32,
    words: wp.array(dtype=wp.uint32),
) -> None:
    w = first + wp.tid()
    bits = wp.uint32(0)
    for k in range(wp.min(32, splat_count - 32 * w)):
        bits |= wp.where((state[32 * w + k] & tested) == wanted, wp.uint32(1) << wp.uint32(k), wp.uint32(0))
    words[w] = bits


@wp.kernel
def combine_kernel(
    first: wp.int32,
    a: wp.array(dtype=wp.uint32),
    b: wp.array(dtype=wp.uint32),
    operation: wp.int32,
    words: wp.array(dtype=wp.uint32),
) -> None:
    w = first + wp.tid()
    if operation == AND:
        words[w] = a[w] & b[w]
    elif operation == OR:
        words[w] = a[w] | b[w]
    elif operation == XOR:
        words[w] = a[w] ^ b[w]
    else:
        words[w] = a[w] & ~b[w]


@wp.kernel
def count_bits_kernel(first: wp.int32, words: wp.array(dtype=wp.uint32), counts: wp.array(dtype=wp.int32)) -> None:
    w = first + wp.tid()
    counts[w] = wp.int32(wp.bit_count(words[w]))


@wp.kernel
def list_bits_kernel(
    first: wp.int32,
    words: wp.array(dtype=wp.uint32),
    counts_until: wp.array(dtype=wp.int32),  # inclusive prefix sum of the words' counts
    indices: wp.array(dtype=wp.int32),
) -> None:
    w = first + wp.tid()
    bits = words[w]
    j = counts_until[w] - wp.int32(wp.bit_count(bits))
    for k in range(32):
        if (bits >> wp.uint32(k)) & wp.uint32(1) != wp.uint32(0):
            indices[j] = 32 * w + k
            j += 1


@wp.func
def has_bit(words: wp.array(dtype=wp.uint32), i: wp.int32) -> wp.bool:
    """Whether splat i is in the set."""
    return ((words[i >> 5] >> wp.uint32(i & 31)) & wp.uint32(1)) != wp.uint32(0)


class Mask:
    """Some of a cloud's splats: bit i & 31 of word i >> 5 stands for splat i; bits past the last splat are 0.

    An immutable value on one device: operators make new masks (`&` both, `|` either, `^` one only, `-` the first and
    not the second). Raises StippleError where two masks are of different clouds' sizes, or memory runs out.
    """

    def __init__(self, words: wp.array, splat_count: int) -> None:
        self.words, self.splat_count = words, splat_count

    @property
    def device(self) -> wp.Device:
        return self.words.device

    @property
    def nbytes(self) -> int:
        return 4 * self.words.size

    def __and__(self, other: Mask) -> Mask:
        return self._combined(other, AND)

    def __or__(self, other: Mask) -> Mask:
        return self._combined(other, OR)

    def __xor__(self, other: Mask) -> Mask:
        return self._combined(other, XOR)

    def __sub__(self, other: Mask) -> Mask:
        return self._combined(other, AND_NOT)

    def count(self) -> int:
        """How many splats are in the set. Reads back from the device."""
        return int(self._counts().numpy().sum(dtype=np.int64))

    def indices(self) -> wp.array:
        """Their indices, ascending, int32 on the device. Reads the count back."""
        until = self._counts()
        wp.utils.array_scan(until, until, inclusive=True)
        count = int(until[-1:].numpy()[0]) if until.size else 0
        indices = allocate(self.device, wp.int32, count, "the splats of a selection", EDIT_LESS)
        if count:
            launch(list_bits_kernel, self.words.size, [self.words, until, indices], self.device)
        return indices

    def numpy(self) -> npt.NDArray[np.bool_]:
        """(N,) bool on the host."""
        as_bytes = np.ascontiguousarray(self.words.numpy()).view(np.uint8)
        return np.unpackbits(as_bytes, count=self.splat_count, bitorder="little").view(np.bool_)

    def _counts(self) -> wp.array:
        counts = allocate(self.device, wp.int32, self.words.size, "counting a selection", EDIT_LESS)
        launch(count_bits_kernel, self.words.size, [self.words, counts], self.device)
        return counts

    def _combined(self, other: Mask, operation: int) -> Mask:
        if self.splat_count != other.splat_count:
            raise StippleError(
                f"selection: one set is of {self.splat_count:,} splats and the other of {other.splat_count:,}; "
                "combine sets of one capture."
            )
        words = new_words(self.splat_count, self.device)
        launch(combine_kernel, words.size, [self.words, other.words, operation, words], self.device)
        return Mask(words, self.splat_count)


def new_words(splat_count: int, device: wp.Device) -> wp.array:
    """Uninitialised words for a set of splats."""
    return allocate(device, wp.uint32, (splat_count + 31) // 32, "a selection", EDIT_LESS)


def mask_from_hits(hits: wp.array, splat_count: int) -> Mask:
    """The splats whose byte in `hits` (uint8) is not 0."""
    words = new_words(splat_count, hits.device)
    launch(pack_kernel, words.size, [hits, splat_count, words], hits.device)
    return Mask(words, splat_count)


def mask_from_numpy(chosen: npt.NDArray[np.bool_], device: wp.Device) -> Mask:
    """The splats where `chosen` (N,) is true."""
    as_bytes = np.packbits(chosen, bitorder="little")
    padded = np.zeros((len(chosen) + 31) // 32 * 4, np.uint8)
    padded[: len(as_bytes)] = as_bytes
    return Mask(wp.array(padded.view(np.uint32), dtype=wp.uint32, device=device), len(chosen))


def empty_mask(splat_count: int, device: wp.Device) -> Mask:
    """No splats."""
    words = new_words(splat_count, device)
    words.zero_()
    return Mask(words, splat_count)


def mask_from_state(state: wp.array, have: int, lack: int) -> Mask:
    """The splats that have all flags of `have` and none of `lack` (sums of the bits in `state.py`)."""
    words = new_words(state.size, state.device)
    launch(match_state_kernel, words.size, [state, state.size, have | lack, have, words], state.device)
    return Mask(words, state.size)
