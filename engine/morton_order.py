# SPDX-License-Identifier: GPL-3.0-or-later
"""Which place each splat of a capture gets: Morton order, shell by shell (`maths.morton`)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import warp as wp

from .device import launch
from .maths.morton import MORTON_BITS, SHELL_COUNT, morton_code

wp.set_module_options({"enable_backward": False})

SAMPLED = 1 << 16  # splats that centre and spread are taken from
CODE_BITS = MORTON_BITS + SHELL_COUNT.bit_length()


@wp.struct
class Measures:
    """What the first reading keeps, in the order of the file."""

    position: wp.array(dtype=wp.vec3)
    scale: wp.array(dtype=wp.vec3)
    brightness: wp.array(dtype=wp.float32)  # largest channel of the base colour; empty with harmonics


@dataclass(frozen=True)
class Layout:
    """Ranks count splats in Morton order; places leave room so that each shell begins with a group of its own.

    - `place_from_source`, `source_from_rank`: (N,) int32 on the device; a source is a splat's number in the file.
    - `shell_end`: per shell the rank after its last.
    - `shift`: log₂ of the splats per group. `place_count`: N and the empty places, a whole number of groups.
    """

    place_from_source: wp.array
    source_from_rank: wp.array
    shell_end: npt.NDArray[np.int32]
    shift: int
    place_count: int

    def ranks_of_groups(self) -> npt.NDArray[np.int32]:
        """(G, 2): first rank of each group and the rank after its last; full, but for the last group of a shell."""
        ranks, rank, size = [], 0, 1 << self.shift
        for end in self.shell_end.tolist():
            starts = np.arange(rank, end, size)
            ranks.append(np.stack([starts, np.minimum(starts + size, end)], axis=1))
            rank = end
        return np.concatenate(ranks).astype(np.int32)


@wp.kernel
def find_codes_kernel(
    first: wp.int32,
    measures: Measures,
    centre: wp.vec3,
    spread: wp.float32,
    codes: wp.array(dtype=wp.int64),
    source_from_rank: wp.array(dtype=wp.int32),
) -> None:
    i = first + wp.tid()
    codes[i] = morton_code(measures.position[i], wp.max(measures.scale[i]), centre, spread)
    source_from_rank[i] = i


@wp.kernel
def find_shell_ends_kernel(
    first: wp.int32, codes: wp.array(dtype=wp.int64), count: wp.int32, shell_end: wp.array(dtype=wp.int32)
) -> None:
    rank = first + wp.tid()
    shell = int(codes[rank] >> wp.int64(MORTON_BITS))
    if rank == count - 1 or int(codes[rank + 1] >> wp.int64(MORTON_BITS)) != shell:
        shell_end[shell] = rank + 1


@wp.kernel
def find_places_kernel(
    first: wp.int32,
    codes: wp.array(dtype=wp.int64),
    source_from_rank: wp.array(dtype=wp.int32),
    shift_of_shell: wp.array(dtype=wp.int32),
    place_from_source: wp.array(dtype=wp.int32),
) -> None:
    rank = first + wp.tid()
    shell = int(codes[rank] >> wp.int64(MORTON_BITS))
    place_from_source[source_from_rank[rank]] = rank + shift_of_shell[shell]


def lay_out(measures: Measures, splat_count: int, device: wp.Device, shift: int) -> Layout:
    """Sorts by shell and Morton code into groups of 2**shift; equal codes keep the order of the file."""
    centre, spread = robust_frame(measures.position[:: max(1, splat_count // SAMPLED)].numpy())
    codes = wp.empty(2 * splat_count, dtype=wp.int64, device=device)  # the radix sort needs twice the room
    source_from_rank = wp.empty(2 * splat_count, dtype=wp.int32, device=device)
    launch(find_codes_kernel, splat_count, [measures, wp.vec3(*centre), spread, codes, source_from_rank], device)
    wp.utils.radix_sort_pairs(codes, source_from_rank, splat_count, end_bit=CODE_BITS)
    shell_end = wp.zeros(SHELL_COUNT, dtype=wp.int32, device=device)
    launch(find_shell_ends_kernel, splat_count, [codes, splat_count, shell_end], device)
    ends = np.maximum.accumulate(shell_end.numpy())
    counts = np.diff(ends, prepend=0)
    places = -(-counts >> shift) << shift  # rounded up to whole groups
    starts = np.cumsum(places) - places
    shift_of_shell = wp.array((starts - (ends - counts)).astype(np.int32), dtype=wp.int32, device=device)
    place_from_source = wp.empty(splat_count, dtype=wp.int32, device=device)
    launch(find_places_kernel, splat_count, [codes, source_from_rank, shift_of_shell, place_from_source], device)
    return Layout(place_from_source, source_from_rank, ends, shift, int(places.sum()))


def robust_frame(position: npt.NDArray[np.float32]) -> tuple[npt.NDArray[np.float64], float]:
    """Centre and spread of means (N, 3): the median, and the largest half-range of the middle half along an axis."""
    low, centre, high = np.percentile(position, (25, 50, 75), axis=0)
    spread = float((high - low).max() / 2)
    if not spread > 0.0:  # half of all lie in one place
        spread = float(np.abs(position - centre).max())
    return centre, spread if spread > 0.0 else 1.0
