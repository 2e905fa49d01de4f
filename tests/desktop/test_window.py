# SPDX-License-Identifier: GPL-3.0-or-later
"""The extension in a real Blender window, judged by screenshots.

Runs where STIPPLE_DESKTOP names a command that starts the desktop program, with these arguments:
`--extension ZIP --mount FOLDER --seconds N --out FOLDER -- BLENDER ARGUMENTS`; the zip is the newest of dist/.
"""

from __future__ import annotations

import json
import os
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

ROOT = Path(__file__).resolve().parents[2]
SECONDS = 240
pytestmark = [pytest.mark.slow, pytest.mark.blender]


def run(scenario: str, folder: Path, *arguments: str) -> dict[str, Any]:
    """Runs a scenario of in_window.py and returns its results."""
    program = os.environ.get("STIPPLE_DESKTOP")
    zips = sorted((ROOT / "dist").glob("stipple-*-linux_x64.zip"), key=lambda path: path.stat().st_mtime)
    if not program or not zips:
        pytest.skip("STIPPLE_DESKTOP is not set, or dist/ has no extension (scripts/build --platform linux_x64)")
    folder.chmod(0o755)
    script = Path(__file__).with_name("in_window.py")
    command = [program, "--extension", str(zips[-1]), "--mount", str(ROOT), "--mount", str(folder)]
    command += [part for path in map(Path, arguments) if path.is_file() for part in ("--mount", str(path.parent))]
    command += ["--seconds", str(SECONDS), "--shots", str(SECONDS // 4), "--out", str(folder / "screen"), "--"]
    command += ["--python", str(script), "--", scenario, str(folder), *arguments]
    subprocess.run(command, cwd=ROOT, check=False, capture_output=True, text=True, timeout=SECONDS + 120)
    log = (folder / "screen" / "blender.log").read_text()
    if (folder / "error.txt").exists():
        pytest.fail((folder / "error.txt").read_text() + log)
    assert (folder / "results.json").exists(), log
    assert "Traceback" not in log, log
    return json.loads((folder / "results.json").read_text())


def region_of(folder: Path, name: str, results: dict[str, Any]) -> np.ndarray:
    """The 3D view's pixels (H, W, 3) of a screenshot, without the edge where buttons are drawn."""
    pixels = np.asarray(Image.open(folder / f"{name}.png").convert("RGB")).astype(int)
    x, y, width, height = results[name]
    return pixels[len(pixels) - y - height : len(pixels) - y, x : x + width][70:-30, 40:-40]


def outline(mask: np.ndarray) -> np.ndarray:
    """Left, right, top and bottom [px]."""
    rows, columns = np.nonzero(mask)
    return np.array([columns.min(), columns.max(), rows.min(), rows.max()], float)


def test_splats_lie_under_the_mesh_they_copy(tmp_path: Path) -> None:
    results = run("alignment", tmp_path)
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


@pytest.mark.parametrize("method", ["SORTED", "RAYS", "POINTS"])
def test_the_viewport_equals_the_final_render(method: str, tmp_path: Path) -> None:
    results = run("final_render", tmp_path, method)
    assert_viewport_is_final(tmp_path, results)


@pytest.mark.real
@pytest.mark.parametrize("method", ["SORTED", "RAYS"])
def test_the_viewport_equals_the_final_render_of_a_capture(method: str, tmp_path: Path, shared_data: Path) -> None:
    results = run("final_render", tmp_path, method, str((shared_data / "real" / "koala.ply").resolve()))
    assert_viewport_is_final(tmp_path, results)


def test_a_frame_of_a_sequence_before_an_environment(tmp_path: Path) -> None:
    from tests.blender.numbered import write_numbered

    folder = write_numbered(tmp_path)
    for path in (folder, *folder.iterdir()):
        path.chmod(0o755)
    results = run("moving", tmp_path, str(folder / "walk.0001.ply"))
    assert_viewport_is_final(tmp_path, results)


def assert_viewport_is_final(tmp_path: Path, results: dict[str, Any]) -> None:
    final = np.asarray(Image.open(tmp_path / "final.png").convert("RGB")).astype(int)[70:-30, 40:-40]
    viewport = region_of(tmp_path, "viewport", results)
    assert viewport.shape == final.shape and final.std() > 10
    assert np.abs(viewport - final).max() <= 1


@pytest.mark.real
def test_a_moved_view_is_drawn_at_once(tmp_path: Path, shared_data: Path) -> None:
    """Blender's own redraw, which a software rasteriser makes slow, is measured apart and not counted."""
    results = run("latency", tmp_path, str((shared_data / "real" / "koala.ply").resolve()))
    first, callbacks = np.array(results["first_shown"]), np.array(results["callbacks"])
    print(f"\nregion {results['region']}, one redraw of the window {results['redraw'] * 1e3:.0f} ms")
    print(f"first picture of a moved view: median {np.median(first) * 1e3:.0f} ms, worst {first.max() * 1e3:.0f} ms")
    print(f"drawing callback: median {np.median(callbacks) * 1e3:.1f} ms, worst {callbacks.max() * 1e3:.0f} ms")
    assert np.median(first) - results["redraw"] < 0.3
    assert np.median(callbacks) < 0.05


def test_a_changed_look_shows_at_once_and_reads_nothing_again(tmp_path: Path) -> None:
    results = run("objects", tmp_path)
    light = {name: results[f"{name} light"] for name in ("whole", "exposed", "cropped", "moved")}
    seen = {name: region_of(tmp_path, name, results) for name in light}
    red = {name: int((pixels[..., 0] - pixels[..., 2] > 60).sum()) for name, pixels in seen.items()}
    assert light["exposed"] < 0.95 * light["whole"]
    assert seen["exposed"].mean() < seen["whole"].mean()
    assert 0.98 * red["whole"] < red["cropped"] < 1.02 * red["whole"], red  # a new crop holds all
    assert 0.2 * red["whole"] < red["moved"] < 0.9 * red["whole"], red
    assert results["read again"] == 0
