# SPDX-License-Identifier: GPL-3.0-or-later
"""A cloud to edit, and a look at all of its bytes."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from stipple.engine.device import choose_device
from stipple.engine.edit.editable_cloud import EditableCloud
from tests.scenes import random_cloud


@pytest.fixture
def make_cloud(device: str) -> Callable[..., EditableCloud]:
    """Random splats in front of the front camera: `make_cloud(count, seed, sh_degree)`."""

    def make(count: int = 3000, seed: int = 1, sh_degree: int = 0) -> EditableCloud:
        return EditableCloud.from_cloud(random_cloud(count, seed, sh_degree=sh_degree), choose_device(device))

    return make
