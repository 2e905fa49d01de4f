# SPDX-License-Identifier: GPL-3.0-or-later
"""A renderer for every device."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from stipple.engine.errors import StippleError
from stipple.engine.renderer import Renderer


@pytest.fixture(scope="session")
def renderer(device: str) -> Iterator[Renderer]:
    """One renderer per device for all tests, so that buffers left over from one scene meet the next."""
    renderer = Renderer(device)
    yield renderer
    renderer.free()


@pytest.fixture(scope="module")
def rays() -> Iterator[Renderer]:
    """A renderer with a graphics context of its own; skips where moderngl or a driver is missing."""
    pytest.importorskip("moderngl")
    try:
        renderer = Renderer("cpu")
        renderer.raster()
    except StippleError as error:
        pytest.skip(str(error))
    yield renderer
    renderer.free()
