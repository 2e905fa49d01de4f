# SPDX-License-Identifier: GPL-3.0-or-later
"""Device memory comes back: scenes made and freed a hundred times leave nothing behind."""

from __future__ import annotations

import gc
import sys

import pytest

from stipple.engine.renderer import Renderer
from stipple.engine.settings import Settings
from tests.scenes import front_camera, random_cloud, scene_of


def resident_bytes() -> int:
    with open("/proc/self/statm") as table:
        return int(table.read().split()[1]) * 4096


@pytest.mark.parametrize("method", ["points", "sorted"])
def test_buffers_are_reused_and_given_back(device: str, method: str) -> None:
    renderer = Renderer(device)
    settings = Settings(method=method, samples=1, storage="quantised")
    held = set()
    for _ in range(5):
        renderer.render(scene_of(random_cloud(2_000, 1)), front_camera(), settings)
        held.add(renderer.buffers.held_bytes)
    assert len(held) == 1 and held != {0}
    renderer.free()
    assert renderer.buffers.held_bytes == 0


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="reads the process's memory from /proc")
def test_a_hundred_scenes_leave_nothing_behind(device: str) -> None:
    """Each scene takes 16 MB and more; a leak of one in ten of them would show."""
    renderer = Renderer(device)
    settings = Settings(method="points", samples=1, storage="quantised")
    resident = []
    for seed in range(100):
        scene = scene_of(random_cloud(60_000, seed, sh_degree=3))
        renderer.render(scene, front_camera(), settings)
        renderer.free()
        del scene
        gc.collect()
        resident.append(resident_bytes())
    assert resident[-1] - min(resident[5:20]) < 24e6
