# SPDX-License-Identifier: GPL-3.0-or-later
"""Edit Splats in a real Blender window, by keys and mouse."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from .conftest import run_scenario

# What keys do to the middle of the selected splats and to how far they reach along the world's axes.
EXACT = {
    "Splats > Move Y -0.5": ((0, -0.5, 0), lambda x, y, z: (x, y, z)),
    "G Y -0.5": ((0, -0.5, 0), lambda x, y, z: (x, y, z)),
    "G Shift-Z 0.25": ((0.25, 0, 0), lambda x, y, z: (x, y, z)),
    "R X 90": ((0, 0, 0), lambda x, y, z: (x, z, y)),
    "S Z 2": ((0, 0, 0), lambda x, y, z: (x, y, 2 * z)),
    "M X": ((0, 0, 0), lambda x, y, z: (x, y, z)),
}

pytestmark = [pytest.mark.slow, pytest.mark.blender, pytest.mark.real]


def test_a_capture_is_edited_by_keys_and_mouse(tmp_path: Path, shared_data: Path) -> None:
    capture = str((shared_data / "real" / "koala.ply").resolve())
    results = run_scenario("scenarios_editing.py", "editing", tmp_path, capture)
    assert results.get("selected too early", 0) == 0
    assert results["editing"] and results["left"] and results["saved"] > 0
    assert results["selected"] == results["deleted"] > 0
    assert results["deleted after undo"] == results["selected after Alt-A"] == 0
    assert results["circle"] == results["copied"] == results["hidden"] > 0
    assert results["hidden after Alt-H"] == results["copies after undo"] == 0
    assert results["radius"][0] != results["radius"][1]
    assert results["moved"] and results["painted"] and results["painted again"]
    for name in ("escape", "undoing the move", "undoing the paint"):
        assert results[f"same after {name}"], name


def test_a_linked_capture_is_edited_by_keys_and_mouse(tmp_path: Path, shared_data: Path) -> None:
    capture = str((shared_data / "real" / "koala.ply").resolve())
    results = run_scenario("scenarios_linked.py", "linked", tmp_path, capture)
    selected = results["selected"]["selected"]
    assert selected == results["moved"]["moved"] == results["deleted"]["deleted"] > 0
    assert results["move undone"]["moved"] == results["deleted"]["selected"] == 0
    assert results["painted"]["painted"] > 0 == results["paint undone"]["painted"]
    assert results["files"] == ["shot.garden.edits.npz"]


def test_tools_axes_numbers_and_captures_apart_and_together(tmp_path: Path, shared_data: Path) -> None:
    capture = str((shared_data / "real" / "koala.ply").resolve())
    found = run_scenario("scenarios_tools.py", "tools", tmp_path, capture)
    assert found["paint icon"] == "stipple.paint_tool" and found["select icon"] == "stipple.select_box_tool"
    assert 0 < found["box"] < found["box and box"] and found["box again"] == found["box"]
    assert 0 < found["circle"] < found["circle and circle"]
    assert found["lasso"] > 0 and found["similar"] > 0
    assert found["linked"] > 0 and found["linked taken away"] == 0
    for name in ("radius", "strength"):
        assert found[name][0] != found[name][1], name
    assert found["painted"] and not found["painted on nothing"]
    assert found["source"] and found["cloned"] > 0 and found["clones after undo"] == 0
    for name, (way, shape) in EXACT.items():
        moved, before, after, same = found[name]
        assert np.allclose(moved, way, atol=1e-4) and np.allclose(after, shape(*before), atol=1e-3), name
        assert not same and found[f"{name} undone"], name
    assert found["separated"] == found["box"] and found["left behind"] + found["separated"] == found["joined"][1]
    assert np.linalg.norm(np.subtract(found["aligned"], (0, 0, 0.4))) > 0.1
    assert found["joined"] == [found["joined"][1], found["joined"][1], 1]
