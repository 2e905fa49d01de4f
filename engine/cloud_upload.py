# SPDX-License-Identifier: GPL-3.0-or-later
"""Bring a cloud of a scene to the device: one that the host holds, or one that makes itself there."""

from __future__ import annotations

from typing import Protocol

import warp as wp

from .device import free_bytes
from .device_cloud import DeviceCloud, upload_cloud
from .errors import StippleError
from .group_bounds import bound_groups
from .memory import gibibytes
from .progress import Progress
from .quantise import quantise, quantising_bytes_per_splat
from .splats import Bounds, SplatCloud


class DeviceSource(Protocol):
    """A cloud that the host does not hold: a capture's file, a generated scene. It is recognised by identity.

    `nbytes` is what it needs on the device while it is uploaded; `bounds` as `SplatCloud.bounds`.
    """

    @property
    def name(self) -> str: ...
    @property
    def splat_count(self) -> int: ...
    @property
    def sh_degree(self) -> int: ...
    @property
    def nbytes(self) -> int: ...
    @property
    def bounds(self) -> Bounds: ...

    def upload(self, device: wp.Device, progress: Progress) -> DeviceCloud:
        """The cloud on the device, with the bounds of its groups. Raises StippleError; lets `Cancelled` through."""
        ...


def upload_any(cloud: SplatCloud | DeviceSource, device: wp.Device, storage: str, progress: Progress) -> DeviceCloud:
    """The cloud on the device, with the bounds of its groups; `storage` as in Settings, for clouds the host holds.

    Raises StippleError where memory does not suffice.
    """
    needed = _bytes_needed(cloud, device, storage)
    if needed > free_bytes(device):
        raise StippleError(
            f"{cloud.name}: {gibibytes(needed)} are needed on {device.alias} and {gibibytes(free_bytes(device))} are "
            "free; render on another device or fewer captures at once."
        )
    if not isinstance(cloud, SplatCloud):
        return cloud.upload(device, progress)
    if storage == "quantised":
        return quantise(lambda _arrays: [cloud], cloud.splat_count, cloud.sh_degree, cloud.name, device)
    uploaded = upload_cloud(cloud, device)
    bound_groups(uploaded, device)
    return uploaded


def _bytes_needed(cloud: SplatCloud | DeviceSource, device: wp.Device, storage: str) -> int:
    if not isinstance(cloud, SplatCloud):
        return cloud.nbytes
    if storage == "quantised":
        return cloud.splat_count * quantising_bytes_per_splat(cloud.sh_degree)
    return cloud.nbytes if device.is_cuda else 0  # a CPU looks at the host's arrays
