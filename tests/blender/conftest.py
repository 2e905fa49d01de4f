# SPDX-License-Identifier: GPL-3.0-or-later
"""A Blender with Stipple registered once, and an empty file for every test."""

from __future__ import annotations

import importlib.util
from collections.abc import Iterator
from pathlib import Path

import pytest

if importlib.util.find_spec("bpy") is None:
    collect_ignore_glob = ["test_*.py"]


@pytest.fixture(scope="session", autouse=True)
def registered() -> Iterator[None]:
    import stipple

    stipple.register()
    yield
    stipple.unregister()


@pytest.fixture(autouse=True)
def empty_file(registered: None) -> None:
    import bpy

    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)


@pytest.fixture
def koala_path(shared_data: Path) -> Path:
    return shared_data / "real" / "koala.ply"
