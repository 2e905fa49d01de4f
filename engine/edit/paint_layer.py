# SPDX-License-Identifier: GPL-3.0-or-later
"""The paint on a cloud: words beside the unpainted arrays, and the painted arrays that follow from both."""

from __future__ import annotations

from dataclasses import dataclass

import warp as wp

from ..buffers import allocate
from ..device import launch
from .editable_cloud import EditableCloud
from .mask import EDIT_LESS
from .paint_word import UNPAINTED as NO_PAINT
from .paint_word import base_colour, brightest_channel, painted_dc, tint_of, unpacked

wp.set_module_options({"enable_backward": False})


# C++ for the reason that `cover.py` gives: three coefficients' lanes at a time.
TINT_REST_NATIVE = """
    const int count = base_rest.shape[1];
    const float* from = (const float*)base_rest.data + (size_t)i * count * 3;
    float* to = (float*)rest.data + (size_t)i * count * 3;
    for (int k = 0; k < count; ++k) {
        float brightest = from[3 * k + channel];
        for (int c = 0; c < 3; ++c) to[3 * k + c] = fmaf(own, from[3 * k + c], brightest * tint[c]);
    }
"""


@wp.func_native(TINT_REST_NATIVE)
def tint_rest(
    base_rest: wp.array2d(dtype=wp.vec3),
    rest: wp.array2d(dtype=wp.vec3),
    i: wp.int32,
    own: wp.float32,
    tint: wp.vec3,
    channel: wp.int32,
) -> None:
    """Splat i's harmonics: `own` of them, and what their brightest channel is in the hue of `tint`."""
    ...


@wp.func
def show_harmonics_of(
    i: wp.int32,
    word: wp.uint64,
    base_dc: wp.array(dtype=wp.vec3),
    base_rest: wp.array2d(dtype=wp.vec3),
    rest: wp.array2d(dtype=wp.vec3),
) -> None:
    """Write splat i's harmonics as painted by a word; nothing where `rest` has no columns."""
    if word == NO_PAINT:
        for k in range(rest.shape[1]):
            rest[i, k] = base_rest[i, k]
    else:
        p = unpacked(word, base_dc[i])
        tint = (p.value - p.own) * tint_of(p.colour)
        tint_rest(base_rest, rest, i, p.own, tint, brightest_channel(base_colour(base_dc[i])))


@wp.kernel
def show_harmonics_kernel(
    first: wp.int32,
    rows: wp.array(dtype=wp.int32),
    paint: wp.array(dtype=wp.uint64),
    base_dc: wp.array(dtype=wp.vec3),
    base_rest: wp.array2d(dtype=wp.vec3),
    rest: wp.array2d(dtype=wp.vec3),
) -> None:
    i = rows[first + wp.tid()]
    show_harmonics_of(i, paint[i], base_dc, base_rest, rest)


@wp.kernel
def swap_words_kernel(
    first: wp.int32,
    rows: wp.array(dtype=wp.int32),
    held: wp.array(dtype=wp.uint64),
    base_dc: wp.array(dtype=wp.vec3),
    paint: wp.array(dtype=wp.uint64),
    sh_dc: wp.array(dtype=wp.vec3),
) -> None:
    j = first + wp.tid()
    i = rows[j]
    word = held[j]
    held[j] = paint[i]
    paint[i] = word
    sh_dc[i] = painted_dc(word, base_dc[i])


@wp.kernel
def swap_values_kernel(
    first: wp.int32,
    rows: wp.array(dtype=wp.int32),
    held: wp.array(dtype=wp.float32),
    values: wp.array(dtype=wp.float32),
) -> None:
    j = first + wp.tid()
    i = rows[j]
    value = held[j]
    held[j] = values[i]
    values[i] = value


def begin_colour_layer(cloud: EditableCloud) -> None:
    """Make room for painted colour beside the unpainted one; nothing looks different.

    Takes 20 bytes per splat and a second copy of the harmonics, once. Hosts call it when the brush is picked up, so
    that the first stroke need not wait. Raises StippleError when memory runs out.
    """
    cloud.array("base_dc")  # a cloud that unpacks colour when it is asked for begins the layer then if it has paint
    if cloud.has("paint"):
        return
    words = allocate(cloud.device, wp.uint64, cloud.splat_count, "paint", EDIT_LESS)
    words.zero_()
    cloud.add_layer({"base_dc", "base_rest"} if cloud.rest_count else {"base_dc"}, {"paint": words})


def begin_opacity_layer(cloud: EditableCloud) -> None:
    """Make room for painted opacity beside the unpainted one: 4 bytes per splat. Raises StippleError for memory."""
    cloud.array("base_opacity")  # as above: painted opacity would come with it
    if not cloud.has("base_opacity"):
        cloud.add_layer({"base_opacity"}, {})


def show_harmonics(cloud: EditableCloud, rows: wp.array) -> None:
    """Work the painted harmonics of some splats out again: their paint or their unpainted harmonics have changed."""
    if not cloud.has("base_rest"):
        return
    arrays = [cloud.array(name) for name in ("paint", "base_dc", "base_rest", "sh_rest")]
    launch(show_harmonics_kernel, rows.size, [rows, *arrays], cloud.device)
    cloud.touched("sh_rest")


@dataclass(frozen=True, eq=False)
class PairDiff:
    """(index, old value) pairs of some splats, swapped with the cloud's: its own inverse."""

    rows: wp.array
    held: wp.array

    @property
    def nbytes(self) -> int:
        return int(self.rows.size) * (4 + wp.types.type_size_in_bytes(self.held.dtype))

    def apply(self, cloud: EditableCloud) -> None:
        raise NotImplementedError

    def revert(self, cloud: EditableCloud) -> None:
        self.apply(cloud)


class PaintDiff(PairDiff):
    """Paint words, 12 bytes a splat; the colours follow."""

    def apply(self, cloud: EditableCloud) -> None:
        arrays = [cloud.array(name) for name in ("base_dc", "paint", "sh_dc")]
        launch(swap_words_kernel, self.rows.size, [self.rows, self.held, *arrays], cloud.device)
        show_harmonics(cloud, self.rows)
        cloud.touched("paint", "sh_dc")


class OpacityDiff(PairDiff):
    """Opacities, 8 bytes a splat."""

    def apply(self, cloud: EditableCloud) -> None:
        launch(swap_values_kernel, self.rows.size, [self.rows, self.held, cloud.array("opacity")], cloud.device)
        cloud.touched("opacity")
