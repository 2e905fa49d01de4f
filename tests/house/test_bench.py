# SPDX-License-Identifier: GPL-3.0-or-later
"""scripts/bench: the table of presets, the JSON it writes, the comparison and the plot, on a preset of no size."""

from __future__ import annotations

import json
import subprocess
import sys
from itertools import pairwise
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest

from stipple.engine.settings import METHODS
from stipple.scripts import bench, bench_presets
from stipple.scripts.bench_compare import comparison
from stipple.scripts.bench_plot import plot_paths
from stipple.scripts.bench_presets import PRESETS, SKY, SMALL_PRESETS, Opened, Preset, city_path
from stipple.scripts.generated_scenes import GeneratedCity

ROW_KEYS = {
    "splats", "sh_degree", "splats_visible", "supersampling", "culling", "storage", "made_from", "frame_ms",
    "frame_p95_ms", "frame_core_ms", "stages_ms", "stages_p95_ms", "stages_core_ms", "points", "rate_per_second",
    "rate_per_core_second", "memory_bytes", "bytes_per_splat", "first_frame", "culling_gain", "quality", "path",
}  # fmt: skip


def tiny() -> Opened:
    source = GeneratedCity(200_000)
    return bench_presets._opened(source, city_path(source), "city", SKY)


@pytest.fixture(scope="module")
def measured(tmp_path_factory: pytest.TempPathFactory) -> tuple[dict[str, Any], str]:
    """One run of everything on a tiny city: what it wrote and what it drew."""
    folder = tmp_path_factory.mktemp("bench")
    patch = pytest.MonkeyPatch()
    patch.setitem(PRESETS, "tiny", Preset("200,000 splats, for this test", tiny, ("points",)))
    arguments = ["--preset", "tiny", "--device", "cpu", "--size", "64x36", "--repeats", "2", "--path", "3"]
    files = ["--json", str(folder / "b.json"), "--plot", str(folder / "p.svg")]
    bench.main([*arguments, *files])
    patch.undo()
    return json.loads((folder / "b.json").read_text()), (folder / "p.svg").read_text()


def test_presets_are_what_their_names_say() -> None:
    assert set(SMALL_PRESETS) < set(PRESETS)
    for millions in (1, 6, 25, 106, 425):
        for kind in ("city", "copies"):
            preset = PRESETS[f"{kind}-{millions}m"]
            assert preset.text.startswith(f"{millions} M splats") and preset.methods == ("points",)
    for name, preset in PRESETS.items():
        assert preset.text and set(preset.methods) <= set(METHODS), name


@pytest.mark.parametrize("name", ["sample", "city-1m", "city-425m"])
def test_a_path_begins_close_and_pulls_away(name: str) -> None:
    opened = PRESETS[name].open()
    assert opened is not None
    low, high = opened.cloud.bounds
    cameras = [opened.path.camera(t, (320, 180)) for t in np.linspace(0, 1, 6)]
    distance = [np.linalg.norm(camera.position - (low + high) / 2) for camera in cameras]
    heights = [-camera.position[1] for camera in cameras]
    assert distance[-1] > 1.5 * distance[0] and all(np.diff(heights) > 0)
    steps = [np.linalg.norm(b.position - a.position) for a, b in pairwise(cameras)]
    assert all(np.diff(steps) > 0), "ever faster"
    if name.startswith("city"):
        assert opened.cloud.splat_count == PRESETS[name].open().cloud.splat_count == 1e6 * int(name[5:-1])  # type: ignore[union-attr]


def test_the_json_holds_what_it_promises(measured: tuple[dict[str, Any], str]) -> None:
    result, _ = measured
    assert {"machine", "size", "repeats", "kernels", "presets"} <= set(result)
    rates = result["machine"]["measured"]
    assert rates["copy_bytes_per_second"] > 1e8 and rates["atomic_minima_per_second"] > 1e5
    row = result["presets"]["tiny"]["points"]
    assert set(row) == ROW_KEYS
    assert row["splats"] == 200_000 and row["points"] > 0
    assert row["bytes_per_splat"]["splats"] == 21.0 and 0 < row["bytes_per_splat"]["groups"] < 1
    assert row["memory_bytes"]["process_peak"] > sum(row["memory_bytes"][k] for k in ("splats", "groups"))
    assert row["stages_ms"].keys() == row["stages_core_ms"].keys() >= {"stage", "counts", "splat", "resolve"}
    assert 0 <= row["culling_gain"]["culled_fraction"] < 1
    assert row["first_frame"]["seconds"] >= row["first_frame"]["upload_seconds"] > 0
    assert row["quality"]["reached_db"] > 25 and row["quality"]["samples"] > 1
    path = row["path"]
    assert path["t"] == [0.0, 0.5, 1.0]
    for culling in ("occlusion", "frustum"):
        assert all(len(values) == 3 and min(values) > 0 for values in path[culling].values())


def test_the_plot_is_a_picture_with_a_line_for_each_way_of_culling(measured: tuple[dict[str, Any], str]) -> None:
    root = ElementTree.fromstring(measured[1])
    lines = [element for element in root if element.tag.endswith("polyline")]
    assert len(lines) == 2 and sum("stroke-dasharray" in line.attrib for line in lines) == 1
    for line in lines:
        x, y = np.array([pair.split(",") for pair in line.attrib["points"].split()], float).T
        assert (x >= 0).all() and (x <= 720).all() and (y >= 0).all() and (y <= 420).all()
        assert (np.diff(x) > 0).all()


def test_higher_values_are_drawn_higher() -> None:
    path = {"t": [0.0, 1.0], "occlusion": {"frame_ms": [3.0, 300.0]}}
    line = next(e for e in ElementTree.fromstring(plot_paths({"a": path}, "frame_ms")) if e.tag.endswith("polyline"))
    low, high = (float(pair.split(",")[1]) for pair in line.attrib["points"].split())
    assert high < low - 150


def test_a_comparison_gives_ratios_and_says_what_cannot_be_compared(measured: tuple[dict[str, Any], str]) -> None:
    result = measured[0]
    slower = json.loads(json.dumps(result))
    row = slower["presets"]["tiny"]["points"]
    row["frame_ms"] *= 4
    assert "frame ×0.25" in "\n".join(comparison(result, slower))
    row["made_from"] = "another capture"
    assert "not compared: another made_from" in "\n".join(comparison(result, slower))
    slower["machine"]["processor"] = "abacus"
    assert "the other machine: processor abacus" in "\n".join(comparison(result, slower))
    slower["size"] = [1, 1]
    assert "not compared" in list(comparison(result, slower))[-1]


def test_it_needs_warp_numpy_and_plyfile_only(root: Path, tmp_path: Path) -> None:
    """Started as on a machine with a GPU, with everything else made impossible to import."""
    blocked = ("matplotlib", "PIL", "click", "rich", "scipy", "skimage", "moderngl", "OpenEXR", "bpy")
    code = (
        f"import sys; sys.modules.update(dict.fromkeys({blocked!r})); sys.path.insert(0, {str(tmp_path)!r});"
        "from stipple.scripts import bench; bench.main(['--preset', 'sample', '--device', 'cpu', '--size', '32x18',"
        f"'--method', 'points', '--repeats', '1', '--no-quality', '--json', {str(tmp_path / 'b.json')!r}])"
    )
    (tmp_path / "stipple").symlink_to(root)
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert json.loads((tmp_path / "b.json").read_text())["presets"]["sample"]["points"]["points"] > 0
