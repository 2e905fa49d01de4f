# SPDX-License-Identifier: GPL-3.0-or-later
"""Sort what is visible by depth, front to back, and lay it out in that order.

Sorting visible splats once is cheaper than sorting their several fragments with depth in the key (Splatshop §3.2.1).
The radix sort is stable, so equal depths keep the order instance, splat.
"""

from __future__ import annotations

import warp as wp

from ..buffers import Buffers
from ..device import launch
from ..maths.projection import DEPTH_KEY_BITS, View, depth_key
from ..staging import Staged, Staging

wp.set_module_options({"enable_backward": False})


@wp.struct
class Ordered:
    """Splats front to back, as blending reads them.

    An offset d from the mean has power -½ (o0² + o1²) with o0 = a dx and o1 = b dx + c dy: the inverse Cholesky factor
    of the covariance. Unlike the usual conic form it sums squares, so needles do not cancel.
    """

    place: wp.array(dtype=wp.vec4)  # mean x, y [px]; opacity; power below which opacity falls under alpha_min
    shape: wp.array(dtype=wp.vec4)  # a, b, c [1/px]; half height of the support, and a little [px]
    colour: wp.array(dtype=wp.vec4)  # as trained; depth [world units]
    covariance: wp.array(dtype=wp.vec4)  # xx, xy, yy [px²]; determinant [px⁴]


@wp.kernel
def find_depth_keys_kernel(
    first: wp.int32,
    staged: Staged,
    view: View,
    keys: wp.array(dtype=wp.int32),
    staged_from_order: wp.array(dtype=wp.int32),
) -> None:
    i = first + wp.tid()
    keys[i] = int(depth_key(staged.centre[i][2], view))
    staged_from_order[i] = i


@wp.kernel
def lay_out_kernel(
    first: wp.int32,
    staged: Staged,
    view: View,
    small_splat_px: wp.float32,
    staged_from_order: wp.array(dtype=wp.int32),
    ordered: Ordered,
) -> None:
    j = first + wp.tid()
    i = staged_from_order[j]
    centre = staged.centre[i]
    covariance = staged.covariance[i]
    colour = staged.colour[i]
    xx, xy, yy, determinant = covariance[0], covariance[1], covariance[2], covariance[3]
    l00 = wp.sqrt(xx)
    l11 = wp.sqrt(determinant) / l00
    cut = wp.log(view.alpha_min / centre[3])
    # Larger eigenvalue of the covariance, whose root is the larger standard deviation.
    middle = 0.5 * (xx + yy)
    largest = middle + wp.sqrt(wp.max(middle * middle - determinant, 0.0))
    reach2 = wp.max(-2.0 * cut, 0.0)
    if wp.sqrt(reach2 * largest) < small_splat_px:
        reach2 = 0.0
    ordered.place[j] = wp.vec4(centre[0], centre[1], centre[3], -0.5 * reach2)
    ordered.shape[j] = wp.vec4(1.0 / l00, -xy / (xx * l11), 1.0 / l11, wp.sqrt(reach2 * yy) + 0.01)
    ordered.colour[j] = wp.vec4(colour[0], colour[1], colour[2], centre[2])
    ordered.covariance[j] = covariance


def sort_by_depth(staging: Staging, view: View, small_splat_px: float, buffers: Buffers) -> Ordered:
    """`staging` in front-to-back order. A splat too faint or too small has power limit 0 and touches nothing."""
    count = staging.count
    # The radix sort needs room for twice the count.
    keys = buffers.array("depth_keys", wp.int32, 2 * count)
    staged_from_order = buffers.array("staged_from_order", wp.int32, 2 * count)
    launch(find_depth_keys_kernel, count, [staging.arrays, view, keys, staged_from_order], buffers.device)
    wp.utils.radix_sort_pairs(keys, staged_from_order, count, end_bit=DEPTH_KEY_BITS)
    ordered = Ordered()
    ordered.place = buffers.array("ordered_place", wp.vec4, count)
    ordered.shape = buffers.array("ordered_shape", wp.vec4, count)
    ordered.colour = buffers.array("ordered_colour", wp.vec4, count)
    ordered.covariance = buffers.array("ordered_covariance", wp.vec4, count)
    inputs = [staging.arrays, view, small_splat_px, staged_from_order, ordered]
    launch(lay_out_kernel, count, inputs, buffers.device)
    return ordered
