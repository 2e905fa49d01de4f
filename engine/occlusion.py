# SPDX-License-Identifier: GPL-3.0-or-later
"""Leave out what is hidden, in two phases that cannot change a bit (§3.5 of doi 10.1145/3811272).

Hidden is what lies behind everything that a depth pyramid holds. The first phase draws what the pyramid of the picture
*before* does not hide, a guess; the second draws all else that the pyramid *now*, made of what has been drawn of this
picture, does not hide. What is left out for good could not have won a single subpixel, whatever the guess was.

Where we differ: blocks are drawn front to back, slab by slab, and the pyramid now is made anew after each slab. So even
the first picture, with nothing before it, leaves out what its own foreground hides; and a subpixel that the first phase
happened to leave open, which hides nothing on all levels above it, is closed before the background is asked.
"""

from __future__ import annotations

import warp as wp

from .buffers import Buffers
from .culling import FATE_NEW, Blocks, bound_group
from .depth_pyramid import DepthPyramid, build_depth_pyramid, is_hidden
from .device import launch
from .maths.projection import DEPTH_KEY_BITS, View, depth_key
from .placements import Placed, Placements

wp.set_module_options({"enable_backward": False})

FRUSTUM_ONLY, FIRST_PHASE, SECOND_PHASE = 0, 1, 2
PHASE_ONE = wp.constant(FIRST_PHASE)
PHASE_TWO = wp.constant(SECOND_PHASE)
FATE_DRAWN = wp.constant(1)  # the first phase has drawn what of the block was not hidden before
FATE_HIDDEN = wp.constant(2)  # all of the block is behind what has been drawn


@wp.struct
class Occlusion:
    """Which phase it is, and what hides."""

    phase: wp.int32
    before: DepthPyramid
    now: DepthPyramid


@wp.func
def is_left_out(occlusion: Occlusion, fate: wp.int32, low: wp.vec2, high: wp.vec2, key: wp.uint32) -> wp.bool:
    """Whether this phase leaves out a splat of a block: it is hidden, or the first phase has drawn it.

    `low`, `high`: the splat's corners [px of the window]; `key` of its depth.
    """
    if occlusion.phase == PHASE_ONE:
        return is_hidden(occlusion.before, low, high, key) or is_hidden(occlusion.now, low, high, key)
    if occlusion.phase == PHASE_TWO:
        if fate == FATE_DRAWN and not is_hidden(occlusion.before, low, high, key):
            return True
        return is_hidden(occlusion.now, low, high, key)
    return False


@wp.func
def is_block_hidden(pyramid: DepthPyramid, placed: Placed, view: View, block: wp.vec3i) -> wp.bool:
    bounds = bound_group(view, placed.pose[block[0]], placed.cloud[block[0]].groups, block[1])
    low, high = bounds.footprint.low - view.window_low, bounds.footprint.high - view.window_low
    return is_hidden(pyramid, low, high, depth_key(wp.max(bounds.nearest, view.near), view))


@wp.kernel
def find_block_depths_kernel(
    first: wp.int32,
    placed: Placed,
    view: View,
    blocks: wp.array(dtype=wp.vec3i),
    keys: wp.array(dtype=wp.int32),
    block_from_order: wp.array(dtype=wp.int32),
) -> None:
    i = first + wp.tid()
    block = blocks[i]
    bounds = bound_group(view, placed.pose[block[0]], placed.cloud[block[0]].groups, block[1])
    keys[i] = int(depth_key(wp.max(bounds.nearest, view.near), view))
    block_from_order[i] = i


@wp.kernel
def reorder_kernel(
    first: wp.int32,
    blocks: wp.array(dtype=wp.vec3i),
    block_from_order: wp.array(dtype=wp.int32),
    ordered: wp.array(dtype=wp.vec3i),
) -> None:
    i = first + wp.tid()
    ordered[i] = blocks[block_from_order[i]]


@wp.kernel
def select_kernel(
    first: wp.int32,
    placed: Placed,
    view: View,
    occlusion: Occlusion,
    blocks: wp.array(dtype=wp.vec3i),
    kept: wp.array(dtype=wp.int32),
) -> None:
    i = first + wp.tid()
    hidden = bool(False)
    if occlusion.phase == PHASE_ONE:
        hidden = is_block_hidden(occlusion.before, placed, view, blocks[i])
    else:
        hidden = is_block_hidden(occlusion.now, placed, view, blocks[i])
    kept[i] = wp.where(hidden, 0, 1)


@wp.kernel
def list_selected_kernel(
    first: wp.int32,
    placed: Placed,
    view: View,
    occlusion: Occlusion,
    blocks: wp.array(dtype=wp.vec3i),
    kept: wp.array(dtype=wp.int32),
    places: wp.array(dtype=wp.int32),
    selected: wp.array(dtype=wp.vec3i),
) -> None:
    i = first + wp.tid()
    if kept[i] != 0:
        block = blocks[i]
        fate = int(FATE_NEW)
        if occlusion.phase == PHASE_TWO and not is_block_hidden(occlusion.before, placed, view, block):
            fate = int(FATE_DRAWN)
        selected[places[i]] = wp.vec3i(block[0], block[1], fate)


@wp.kernel
def hide_blocks_kernel(
    first: wp.int32, placed: Placed, view: View, now: DepthPyramid, begin: wp.int32, blocks: wp.array(dtype=wp.vec3i)
) -> None:
    i = begin + first + wp.tid()
    block = blocks[i]
    if is_block_hidden(now, placed, view, block):
        blocks[i] = wp.vec3i(block[0], block[1], FATE_HIDDEN)


def front_to_back(blocks: Blocks, placements: Placements, view: View, buffers: Buffers) -> Blocks:
    """The blocks ordered by the depth that none of their means is in front of."""
    count = blocks.count
    keys = buffers.array("block_keys", wp.int32, 2 * count)  # the radix sort needs twice the room
    block_from_order = buffers.array("block_from_order", wp.int32, 2 * count)
    ordered = buffers.array("blocks_front_to_back", wp.vec3i, count)
    if count:
        inputs = [placements.placed, view, blocks.array, keys, block_from_order]
        launch(find_block_depths_kernel, count, inputs, buffers.device)
        wp.utils.radix_sort_pairs(keys, block_from_order, count, end_bit=DEPTH_KEY_BITS)
        launch(reorder_kernel, count, [blocks.array, block_from_order, ordered], buffers.device)
    return Blocks(ordered, count)


def select_blocks(blocks: Blocks, placements: Placements, view: View, occlusion: Occlusion, buffers: Buffers) -> Blocks:
    """What this phase may have to draw, in the same order. Reads their number back."""
    count = blocks.count
    if count == 0:
        return blocks
    kept = buffers.array("block_kept", wp.int32, count)
    places = buffers.array("block_places", wp.int32, count)
    inputs = [placements.placed, view, occlusion, blocks.array]
    launch(select_kernel, count, [*inputs, kept], buffers.device)
    wp.utils.array_scan(kept, places, inclusive=False)
    selected_count = int(places[-1:].numpy()[0] + kept[-1:].numpy()[0])
    selected = buffers.array("blocks_selected", wp.vec3i, selected_count)
    launch(list_selected_kernel, count, [*inputs, kept, places, selected], buffers.device)
    return Blocks(selected, selected_count)


def hide_blocks(
    blocks: Blocks, begin: int, end: int, placements: Placements, view: View, now: DepthPyramid, device: wp.Device
) -> None:
    """Marks which of blocks `begin` … `end` - 1 are hidden by now, so that their splats are not read."""
    launch(hide_blocks_kernel, end - begin, [placements.placed, view, now, begin, blocks.array], device)


class OcclusionMemory:
    """The pyramid of the sample before, of this frame or the last: the guess of the first phase.

    Two buffers take turns, so that the pyramid before is whole while the one now is built.
    """

    def __init__(self) -> None:
        self._before: tuple[tuple[int, int], DepthPyramid] | None = None
        self._turn = 0

    def begin(self, size: tuple[int, int]) -> Occlusion:
        """The first phase of a sample of a window of `size` [px]; a memory of another size is of no use."""
        occlusion = Occlusion()
        occlusion.phase = FIRST_PHASE
        if self._before is not None and self._before[0] == size:
            occlusion.before = self._before[1]
        self._turn = 1 - self._turn
        return occlusion

    def look(
        self, occlusion: Occlusion, visibility: wp.array, size: tuple[int, int], subpixels: int, buffers: Buffers
    ) -> None:
        """Makes the pyramid now of what has been drawn, and remembers it for the next sample."""
        occlusion.now = build_depth_pyramid(visibility, *size, subpixels, f"depth_pyramid_{self._turn}", buffers)
        self._before = (size, occlusion.now)

    def forget(self) -> None:
        self._before = None
