# SPDX-License-Identifier: GPL-3.0-or-later
"""The extension in a real Blender window, judged by screenshots; `program` says what it takes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from .conftest import region_of, run_scenario

pytestmark = [pytest.mark.slow, pytest.mark.blender]


def outline(mask: np.ndarray) -> np.ndarray:
    """Left, right, top and bottom [px]."""
    rows, columns = np.nonzero(mask)
    return np.array([columns.min(), columns.max(), rows.min(), rows.max()], float)


def test_splats_lie_under_the_mesh_they_copy(tmp_path: Path) -> None:
    results = run_scenario("scenarios.py", "alignment", tmp_path)
    for kind in ("PERSP", "ORTHO", "CAMERA", "CAMERA_ORTHO"):
        mesh = region_of(tmp_path, f"{kind}-mesh", results).min(axis=2) > 128
        seen = region_of(tmp_path, f"{kind}-splats", results)
        splats = seen[..., 0] - seen[..., 2] > 110  # the half-way line of a soft edge
        assert mesh.sum() > 5000, kind
        centre = [np.argwhere(mask).mean(axis=0) for mask in (mesh, splats)]
        # In perspective near edges have wider soft rims than far ones, which pulls the centre of the splats.
        assert np.abs(centre[0] - centre[1]).max() < (0.05 if "ORTHO" in kind else 0.35), (kind, centre)
        assert np.abs(outline(mesh) - outline(splats)).max() <= 2.5, (kind, outline(mesh), outline(splats))
        assert (mesh ^ splats).sum() < 0.04 * mesh.sum(), kind


def test_a_render_region_shows_its_part_of_the_same_picture(tmp_path: Path) -> None:
    """Of the camera's frame, with lens shift, and of the whole 3D view in perspective."""
    results = run_scenario("scenarios.py", "borders", tmp_path)
    width, height = results["PERSP-whole"][2:]
    for kind, (left, bottom, right, top) in (("CAMERA", results["frame"]), ("PERSP", (0, 0, width, height))):
        whole, bordered = (region_of(tmp_path, f"{kind}-{name}", results) for name in ("whole", "border"))
        # Pixels from the top left of what `region_of` leaves.
        columns = left + np.array([0.3, 0.55]) * (right - left) - 40
        rows = height - (bottom + np.array([0.6, 0.35]) * (top - bottom)) - 70
        (x0, x1), (y0, y1) = columns.astype(int), rows.astype(int)
        inside = np.abs(whole - bordered)[y0 + 3 : y1 - 2, x0 + 3 : x1 - 2]
        assert inside.size and inside.max() <= 1, kind
        is_red = bordered[..., 0] - bordered[..., 2] > 110
        assert is_red[y0 + 3 : y1 - 2, x0 + 3 : x1 - 2].mean() > 0.2, kind
        is_red[max(0, y0 - 3) : y1 + 3, max(0, x0 - 3) : x1 + 3] = False
        assert not is_red.any(), kind


@pytest.mark.parametrize("method", ["SORTED", "RAYS", "POINTS"])
def test_the_viewport_equals_the_final_render(method: str, tmp_path: Path) -> None:
    results = run_scenario("scenarios.py", "final_render", tmp_path, method)
    assert_viewport_is_final(tmp_path, results)


@pytest.mark.real
@pytest.mark.parametrize("method", ["SORTED", "RAYS"])
def test_the_viewport_equals_the_final_render_of_a_capture(method: str, tmp_path: Path, shared_data: Path) -> None:
    results = run_scenario(
        "scenarios.py", "final_render", tmp_path, method, str((shared_data / "real" / "koala.ply").resolve())
    )
    assert_viewport_is_final(tmp_path, results)


def test_a_frame_of_a_sequence_before_an_environment(tmp_path: Path) -> None:
    from tests.blender.numbered import write_numbered

    folder = write_numbered(tmp_path)
    for path in (folder, *folder.iterdir()):
        path.chmod(0o755)
    results = run_scenario("scenarios.py", "moving", tmp_path, str(folder / "walk.0001.ply"))
    assert_viewport_is_final(tmp_path, results)


def assert_viewport_is_final(tmp_path: Path, results: dict[str, Any]) -> None:
    final = np.asarray(Image.open(tmp_path / "final.png").convert("RGB")).astype(int)[70:-30, 40:-40]
    viewport = region_of(tmp_path, "viewport", results)
    assert viewport.shape == final.shape and final.std() > 10
    assert np.abs(viewport - final).max() <= 1
