# SPDX-License-Identifier: GPL-3.0-or-later
"""Find the bounds of a cloud's groups, from the splats as kernels read them, quantised or not."""

from __future__ import annotations

import warp as wp

from .device import launch
from .device_cloud import DeviceCloud, read_rotation, read_splat
from .groups import shift_for

wp.set_module_options({"enable_backward": False})

FAR = wp.constant(1e18)  # what is larger counts as boundless; its square is still a float


@wp.kernel
def bound_groups_kernel(first: wp.int32, cloud: DeviceCloud) -> None:
    group = first + wp.tid()
    low = wp.vec3(FAR, FAR, FAR)
    high = -low
    variance = wp.vec3(0.0, 0.0, 0.0)
    opacity = float(-1.0)
    begin = group << cloud.groups.shift
    for i in range(begin, wp.min(begin + (1 << cloud.groups.shift), cloud.splat_count)):
        splat = read_splat(cloud, i)
        p = splat.position
        # Comparisons with NaN fail: such a splat is never drawn.
        if splat.opacity > 0.0 and wp.length_sq(p) >= 0.0 and wp.length_sq(splat.scale) >= 0.0:
            q = read_rotation(cloud, i)
            axes = wp.quat_to_matrix(wp.quat(q[1], q[2], q[3], q[0]))
            for k in range(3):
                row = wp.cw_mul(axes[k], wp.min(splat.scale, wp.vec3(FAR, FAR, FAR)))
                variance[k] = wp.max(variance[k], wp.dot(row, row))
            low = wp.min(low, p)
            high = wp.max(high, p)
            opacity = wp.max(opacity, splat.opacity)
    cloud.groups.low[group] = low
    cloud.groups.high[group] = high
    # A little more, for what rounding takes.
    cloud.groups.sigma[group] = 1.00001 * wp.vec3(wp.sqrt(variance[0]), wp.sqrt(variance[1]), wp.sqrt(variance[2]))
    cloud.groups.opacity[group] = opacity


def bound_groups(cloud: DeviceCloud, device: wp.Device) -> None:
    """Allocates and fills `low`, `high`, `sigma` and `opacity` of the cloud's groups; keeps their packing ranges."""
    groups = cloud.groups
    if groups.shift == 0:  # a quantised cloud was laid out with one
        groups.shift = shift_for(cloud.splat_count)
    groups.count = -(-cloud.splat_count // (1 << groups.shift))
    groups.low = wp.empty(groups.count, dtype=wp.vec3, device=device)
    groups.high = wp.empty(groups.count, dtype=wp.vec3, device=device)
    groups.sigma = wp.empty(groups.count, dtype=wp.vec3, device=device)
    groups.opacity = wp.empty(groups.count, dtype=wp.float32, device=device)
    cloud.groups = groups
    launch(bound_groups_kernel, groups.count, [cloud], device, smallest_chunk=16)
