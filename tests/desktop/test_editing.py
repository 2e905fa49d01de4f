# SPDX-License-Identifier: GPL-3.0-or-later
"""Edit Splats in a real Blender window, by keys and mouse."""

from __future__ import annotations

from pathlib import Path

import pytest

from .conftest import run_scenario

pytestmark = [pytest.mark.slow, pytest.mark.blender, pytest.mark.real]


def test_a_capture_is_edited_by_keys_and_mouse(tmp_path: Path, shared_data: Path) -> None:
    capture = str((shared_data / "real" / "koala.ply").resolve())
    results = run_scenario("scenarios_editing.py", "editing", tmp_path, capture)
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
