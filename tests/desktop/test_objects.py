# SPDX-License-Identifier: GPL-3.0-or-later
"""The settings of one object in a real Blender window, judged by screenshots."""

from __future__ import annotations

from pathlib import Path

import pytest

from .conftest import region_of, run_scenario

pytestmark = [pytest.mark.slow, pytest.mark.blender]


def test_a_changed_look_shows_at_once_and_reads_nothing_again(tmp_path: Path) -> None:
    results = run_scenario("scenarios_objects.py", "objects", tmp_path)
    light = {name: results[f"{name} light"] for name in ("whole", "exposed", "cropped", "moved")}
    seen = {name: region_of(tmp_path, name, results) for name in light}
    red = {name: int((pixels[..., 0] - pixels[..., 2] > 60).sum()) for name, pixels in seen.items()}
    assert light["exposed"] < 0.95 * light["whole"]
    assert seen["exposed"].mean() < seen["whole"].mean()
    assert 0.98 * red["whole"] < red["cropped"] < 1.02 * red["whole"], red  # a new crop holds all
    assert 0.2 * red["whole"] < red["moved"] < 0.9 * red["whole"], red
    assert results["read again"] == 0
