# SPDX-License-Identifier: GPL-3.0-or-later
"""What the flags mean to kernels, and what holding a cloud for editing costs."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
import warp as wp

from stipple.engine.device import launch
from stipple.engine.edit.editable_cloud import EditableCloud
from stipple.engine.edit.history import History
from stipple.engine.edit.mask import mask_from_numpy
from stipple.engine.edit.selection import select
from stipple.engine.edit.state import DELETED, HIDDEN, LOCKED, SELECTED, acts, selectable, shown
from stipple.engine.errors import StippleError
from stipple.engine.splats import ARRAY_NAMES
from tests.scenes import random_cloud

Clouds = Callable[..., EditableCloud]


@wp.kernel
def ask_kernel(first: wp.int32, state: wp.array(dtype=wp.uint32), answers: wp.array2d(dtype=wp.int32)) -> None:
    i = first + wp.tid()
    answers[i, 0] = wp.where(shown(state[i]), 1, 0)
    answers[i, 1] = wp.where(selectable(state[i]), 1, 0)
    answers[i, 2] = wp.where(acts(state[i]), 1, 0)


def test_flags_in_kernels(make_cloud: Clouds) -> None:
    """All sixteen combinations; what kernels answer is what selections act on."""
    cloud = make_cloud(16)
    state = np.arange(16, dtype=np.uint32)
    cloud.state.assign(state)
    answers = wp.zeros((16, 3), dtype=wp.int32, device=cloud.device)
    launch(ask_kernel, 16, [cloud.state, answers], cloud.device)
    is_shown = (state & (HIDDEN | DELETED)) == 0
    free = is_shown & ((state & LOCKED) == 0)
    acting = free & ((state & SELECTED) != 0)
    np.testing.assert_array_equal(answers.numpy(), np.column_stack([is_shown, free, acting]))
    np.testing.assert_array_equal(cloud.selectable().numpy(), free)
    np.testing.assert_array_equal(cloud.selection().numpy(), acting)
    np.testing.assert_array_equal(cloud.kept().numpy(), (state & DELETED) == 0)


def test_selecting_holds_four_bytes_per_splat_and_writes_nothing_of_the_hosts(device: str) -> None:
    host = random_cloud(3200, 1, sh_degree=3)
    copies = {name: getattr(host, name).copy() for name in ARRAY_NAMES}
    cloud = EditableCloud.from_cloud(host, wp.get_device(device))
    if cloud.device.is_cpu:
        assert cloud.held_bytes == 4 * 3200
    seen = dict(cloud.versions)
    History(cloud).do(select(cloud, mask_from_numpy(np.arange(3200) < 10, cloud.device)))
    assert [name for name in seen if cloud.versions[name] != seen[name]] == ["state"]
    cloud.writable("position").zero_()
    assert not cloud.host("position").any()
    for name, copy in copies.items():
        assert np.array_equal(getattr(host, name), copy)


def test_attributes_that_are_missing_are_named(device: str) -> None:
    host, on = random_cloud(100, 1), wp.get_device(device)
    cloud = EditableCloud.from_cloud(host, on, ["opacity"])
    with pytest.raises(StippleError, match="scale, which was not loaded"):
        cloud.array("scale")
    with pytest.raises(StippleError, match="which was not loaded"):
        cloud.to_cloud()
    with pytest.raises(StippleError, match="needs position"):
        EditableCloud({"opacity": host.opacity}, on)
    with pytest.raises(StippleError, match="contiguous float32 with 100 rows"):
        EditableCloud({"position": host.position, "opacity": host.opacity[:50]}, on)
