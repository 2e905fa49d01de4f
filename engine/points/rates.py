# SPDX-License-Identifier: GPL-3.0-or-later
"""How many points each splat should throw, once per frame: rate λ of Eq. 3.

Where we differ: a splat so large that its λ exceeds the subpixels of its (frame-clipped) bounding box is not thrown
at but *filled*: one candidate per subpixel, accepted with that subpixel's opacity. That is the paper's clamp to one
point per subpixel (§4.3), without the opacity the clamp takes away. Filled is also what a look displays as something
else than a splat: it is opaque, not random.
"""

from __future__ import annotations

import warp as wp

from ..buffers import Buffers
from ..device import launch
from ..device_look import opaque_from
from ..maths.dilogarithm import li2
from ..maths.projection import View
from ..staging import Staged, Staging

wp.set_module_options({"enable_backward": False})

FILLED = wp.constant(-1.0)


@wp.func
def box_between(half: wp.vec2, centre: wp.vec4, low: wp.vec2, high: wp.vec2, subpixels: wp.int32) -> wp.vec4i:
    """Subpixels x0, y0, width, height that centre ± `half` [px] touches between two corners."""
    s = float(subpixels)
    # Clamped as floats: a huge splat's corners do not fit an int.
    x0 = int(wp.floor(s * wp.clamp(centre[0] - half[0], low[0], high[0])))
    y0 = int(wp.floor(s * wp.clamp(centre[1] - half[1], low[1], high[1])))
    x1 = int(wp.ceil(s * wp.clamp(centre[0] + half[0], low[0], high[0])))
    y1 = int(wp.ceil(s * wp.clamp(centre[1] + half[1], low[1], high[1])))
    return wp.vec4i(x0, y0, x1 - x0, y1 - y0)


@wp.func
def support_half(view: View, covariance: wp.vec4, centre: wp.vec4) -> wp.vec2:
    """How far the support (opacity >= alpha_min) reaches from the mean along x and y [px]; negative if nowhere."""
    reach2 = 2.0 * wp.log(centre[3] / view.alpha_min)
    if not reach2 > 0.0:
        return wp.vec2(-1.0, -1.0)
    return wp.vec2(wp.sqrt(reach2 * covariance[0]), wp.sqrt(reach2 * covariance[2]))


@wp.func
def support_box(
    view: View, covariance: wp.vec4, centre: wp.vec4, low: wp.vec2, high: wp.vec2, subpixels: wp.int32
) -> wp.vec4i:
    """Subpixels x0, y0, width, height that the splat's support touches between two corners."""
    half = support_half(view, covariance, centre)
    if half[0] < 0.0:
        return wp.vec4i(0, 0, 0, 0)
    return box_between(half, centre, low, high, subpixels)


@wp.kernel
def find_rates_kernel(
    first: wp.int32, staged: Staged, view: View, subpixels: wp.int32, rates: wp.array(dtype=wp.float32)
) -> None:
    i = first + wp.tid()
    centre, covariance = staged.centre[i], staged.covariance[i]
    half = support_half(view, covariance, centre)
    if half[0] < 0.0:
        rates[i] = 0.0
        return
    in_window = box_between(half, centre, view.window_low, view.window_high, subpixels)
    in_frame = box_between(half, centre, wp.vec2(0.0, 0.0), view.frame_px, subpixels)
    # A is a subpixel's area, so 1/A is subpixels².
    per_pixel = float(subpixels * subpixels)
    opacity = wp.min(centre[3], 1.0)
    rate = per_pixel * 6.2831855 * wp.sqrt(covariance[3]) * li2(opacity)
    if in_window[2] * in_window[3] == 0:
        rate = 0.0
    elif centre[3] >= opaque_from or rate > float(in_frame[2]) * float(in_frame[3]):
        rate = FILLED
    rates[i] = rate


def find_rates(staging: Staging, view: View, subpixels: int, buffers: Buffers) -> wp.array:
    """λ per staged splat, 0 where no pixel is touched, FILLED where one candidate per subpixel is cheaper."""
    rates = buffers.array("rates", wp.float32, staging.count)
    launch(find_rates_kernel, staging.count, [staging.arrays, view, subpixels, rates], buffers.device)
    return rates
