# SPDX-License-Identifier: GPL-3.0-or-later
"""What every test may ask for: the real captures, a device, and where this checkout is."""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
SHARED_DATA = ROOT.parent / "shared" / "data"

# Modules in tests/blender import bpy, which a machine that only tests CUDA kernels need not have.
collect_ignore = [] if find_spec("bpy") else ["blender"]


def pytest_report_header() -> list[str]:
    lines = [] if find_spec("bpy") else ["stipple: bpy is not installed, tests/blender is left out"]
    if not SHARED_DATA.is_dir():
        lines.append("stipple: no real captures in ../shared/data, their tests are skipped")
    return lines


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Skip what is marked blender where there is no bpy (a test that starts Blender in a process of its own)."""
    if find_spec("bpy"):
        return
    for item in items:
        if item.get_closest_marker("blender"):
            item.add_marker(pytest.mark.skip(reason="bpy is not installed"))


@pytest.fixture(scope="session")
def root() -> Path:
    """The checkout."""
    return ROOT


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """The folder with `real/` and `formats/`; skips the test where it is absent. Mark such tests `real`."""
    if not SHARED_DATA.is_dir():
        pytest.skip("the captures in ../shared/data are not here")
    return SHARED_DATA


@pytest.fixture(scope="session", params=["cpu", pytest.param("cuda:0", marks=pytest.mark.cuda)])
def device(request: pytest.FixtureRequest) -> str:
    """The name of a Warp device: "cpu", and "cuda:0" where there is one. Runs the test once for each."""
    name = str(request.param)
    if name != "cpu":
        import warp as wp

        if not wp.is_cuda_available():
            pytest.skip("no CUDA device")
    return name
