# SPDX-License-Identifier: GPL-3.0-or-later
"""The `stipple` command: what it prints, what it writes, and the status it ends with."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from stipple.engine.formats import write_splats
from stipple.engine.formats.cameras_file import read_cameras
from stipple.engine.splats import SplatCloud
from tests.colmap_files import Lens, view_of, write_binary

pytest.importorskip("click")
pytest.importorskip("rich")

from stipple.engine.cli import main
from stipple.engine.cli_frames import numbered
from stipple.engine.memory import byte_size

QUICK = ["--size", "48x32", "--device", "cpu"]


@pytest.fixture(scope="module")
def capture(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """300 splats of one colour in a ball of radius 1 around the origin, SH degree 1."""
    rng = np.random.default_rng(2)
    position = rng.normal(size=(300, 3))
    position *= rng.random((300, 1)) / np.linalg.norm(position, axis=1, keepdims=True)
    cloud = SplatCloud(
        position=position.astype(np.float32),
        scale=np.full((300, 3), 0.1, np.float32),
        rotation=np.tile(np.array([1, 0, 0, 0], np.float32), (300, 1)),
        opacity=np.full(300, 0.75, np.float32),
        sh_dc=np.tile(np.array([1, 0, -1], np.float32), (300, 1)),
        sh_rest=np.zeros((300, 3, 3), np.float32),
    )
    path = tmp_path_factory.mktemp("captures") / "ball.ply"
    write_splats(path, cloud)
    return path


@pytest.fixture
def cameras(tmp_path: Path) -> Path:
    """Three cameras along z, four units away from the origin and looking at it; 40×30 px."""
    camera = {"width": 40, "height": 30, "fx": 30, "fy": 30, "rotation": np.eye(3).tolist()}
    path = tmp_path / "cameras.json"
    path.write_text(json.dumps([camera | {"position": [0.4 * index, 0, -4]} for index in range(3)]))
    return path


def picture_of(path: Path) -> np.ndarray:
    return np.load(path)


def test_info_for_people(capture: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["info", str(capture)]) == 0
    printed = capsys.readouterr()
    assert "splats     300 (0 dropped)" in printed.out
    assert "SH degree  1" in printed.out
    assert "p50 0.75" in printed.out and "p50 0.1," in printed.out
    assert printed.err == ""


def test_info_for_programs(capture: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["info", "--json", str(capture)]) == 0
    facts = json.loads(capsys.readouterr().out)
    assert (facts["splats"], facts["dropped"], facts["sh_degree"]) == (300, 0, 1)
    assert facts["file_bytes"] == capture.stat().st_size
    assert all(-1 <= low < high <= 1 for low, high in zip(*facts["bounds"].values(), strict=True))
    assert facts["opacity"]["p99"] == pytest.approx(0.75, rel=1e-5)
    assert facts["scale"]["p1"] == pytest.approx(0.1, rel=1e-5)


def test_info_and_help_do_not_import_warp(capture: Path) -> None:
    program = (
        "import sys; from stipple.engine.cli import main;"
        f"status = main(['info', {str(capture)!r}]) or main(['render', '--help']);"
        "sys.exit(status or 'warp' in sys.modules or 'bpy' in sys.modules)"
    )
    assert subprocess.run([sys.executable, "-c", program], check=False, capture_output=True).returncode == 0


def test_a_missing_library_is_one_sentence() -> None:
    program = "import sys; sys.modules['click'] = None; from stipple.engine.cli import main; sys.exit(main(['info']))"
    done = subprocess.run([sys.executable, "-c", program], check=False, capture_output=True, text=True)
    assert (done.returncode, done.stdout) == (1, "")
    assert done.stderr == "error: the command line needs the Python package click; install it with pip.\n"


def test_rays_without_graphics_are_one_sentence(capture: Path, tmp_path: Path) -> None:
    pytest.importorskip("moderngl")
    program = "import sys; from stipple.engine.cli import main; sys.exit(main(sys.argv[1:]))"
    command = [sys.executable, "-c", program, "render", str(capture), "--out", str(tmp_path / "a.png"), *QUICK]
    hidden = {"__EGL_VENDOR_LIBRARY_FILENAMES": "/nonexistent.json", "DISPLAY": ""}
    environment = dict(os.environ) | hidden
    command += ["--method", "rays"]
    done = subprocess.run(command, check=False, capture_output=True, text=True, env=environment)
    assert done.returncode == 1 and not (tmp_path / "a.png").exists()
    assert "choose the sorted method instead" in done.stderr and "Traceback" not in done.stderr
    command[-1] = "sorted"
    assert subprocess.run(command, check=False, capture_output=True, env=environment).returncode == 0


def test_sizes_in_bytes() -> None:
    assert [byte_size(count) for count in (0, 999, 1000, 2_340_000, 5e12)] == [
        "0 B",
        "999 B",
        "1 kB",
        "2.34 MB",
        "5 TB",
    ]


@pytest.mark.parametrize(
    ("pattern", "number", "expected"),
    [
        ("a####.png", 7, "a0007.png"),
        ("a%04d.png", 7, "a0007.png"),
        ("a%d.png", 7, "a7.png"),
        ("#_##.png", 123, "#_123.png"),
        ("plain.png", 7, "plain.png"),
    ],
)
def test_numbers_in_names(pattern: str, number: int, expected: str) -> None:
    assert numbered(Path("shot#1") / pattern, number) == Path("shot#1") / expected


USAGE_ERRORS = {
    "no command": [],
    "unknown command": ["paint"],
    "no file": ["render", "--out", "a.png"],
    "no output": ["render", "a.ply"],
    "unknown option": ["render", "a.ply", "--out", "a.png", "--shiny"],
    "method": ["render", "a.ply", "--out", "a.png", "--method", "wings"],
    "size": ["render", "a.ply", "--out", "a.png", "--size", "big"],
    "empty size": ["render", "a.ply", "--out", "a.png", "--size", "0x5"],
    "colour": ["render", "a.ply", "--out", "a.png", "--background", "white"],
    "colour range": ["render", "a.ply", "--out", "a.png", "--background", "0,0,255"],
    "NaN colour": ["render", "a.ply", "--out", "a.png", "--background", "0,0,nan"],
    "samples": ["render", "a.ply", "--out", "a.png", "--samples", "0"],
    "two cameras": ["render", "a.ply", "--out", "a.png", "--camera", "c.json", "--orbit", "3"],
    "orbit without numbers": ["render", "a.ply", "--out", "a.png", "--orbit", "3"],
}


@pytest.mark.parametrize("case", USAGE_ERRORS)
def test_wrong_command_lines_end_with_2(
    case: str, capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(USAGE_ERRORS[case]) == 2
    printed = capsys.readouterr()
    assert "Usage: stipple" in printed.err + printed.out
    assert list(tmp_path.iterdir()) == []


def test_problems_with_files_end_with_1_and_one_line(
    capture: Path, cameras: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "mesh.ply").write_text("ply\nformat ascii 1.0\nelement vertex 0\nend_header\n")
    out = str(tmp_path / "a.npy")
    cases = {
        "no such file": ["info", str(tmp_path / "absent.ply")],
        "mesh.ply": ["render", str(tmp_path / "mesh.ply"), "--out", out],
        ".gif is not a picture format": ["render", str(capture), "--out", "a.gif"],
        "there is no camera 3; choose 0 to 2": ["render", str(capture), "--out", out, "--camera", f"{cameras}:3"],
        "not a camera file": ["render", str(capture), "--out", out, "--camera", str(tmp_path / "odd.json")],
        "seed is 4294967296": ["render", str(capture), "--out", out, "--seed", str(1 << 32)],
        "elevation is 90°": ["render", str(capture), "--out", out, "--elevation", "90"],
    }
    (tmp_path / "odd.json").write_text("{}")
    before = sorted(tmp_path.iterdir())
    for words, arguments in cases.items():
        assert main(arguments) == 1, words
        printed = capsys.readouterr()
        assert words in printed.err
        assert printed.err.startswith("error: ") and printed.err.count("\n") == 1
        assert printed.out == ""
    assert sorted(tmp_path.iterdir()) == before


def test_render_shows_the_capture(capture: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The capture's one colour in the middle, nothing at the corners, and a summary with the path."""
    out = tmp_path / "a.npy"
    assert main(["render", str(capture), "--out", str(out), "--method", "sorted", *QUICK]) == 0
    rgba = picture_of(out)
    assert rgba.shape == (32, 48, 4)
    assert rgba[16, 24, 3] > 0.9
    colour = np.clip(0.5 + 0.28209479 * np.array([1, 0, -1]), 0, None)
    np.testing.assert_allclose(rgba[16, 24, :3] / rgba[16, 24, 3], colour, atol=1e-4)
    assert rgba[[0, 0, -1, -1], [0, -1, 0, -1]].max() < 0.05
    printed = capsys.readouterr().out
    assert printed.startswith(f"{out}: 48×32, 1 sample in ") and "blends/s, peak memory" in printed
    assert printed.count("\n") == 1


def test_points_and_sorted_agree(capture: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pictures = {}
    for method, samples in (("sorted", "1"), ("points", "64")):
        out = tmp_path / f"{method}.npy"
        arguments = ["render", str(capture), "--out", str(out), "--method", method, "--samples", samples, *QUICK]
        assert main(arguments) == 0
        pictures[method] = picture_of(out)
    assert "64 samples" in capsys.readouterr().out
    assert np.sqrt(np.mean((pictures["points"] - pictures["sorted"]) ** 2)) < 0.05


def test_all_cameras_of_a_file_are_numbered(capture: Path, cameras: Path, tmp_path: Path) -> None:
    common = ["render", str(capture), "--method", "sorted", "--device", "cpu", "--camera"]
    assert main([*common, str(cameras), "--out", str(tmp_path / "all" / "v##.npy")]) == 0
    assert sorted(path.name for path in (tmp_path / "all").iterdir()) == ["v00.npy", "v01.npy", "v02.npy"]
    assert main([*common, f"{cameras}:2", "--out", str(tmp_path / "one.npy")]) == 0
    assert main([*common, str(cameras), "--out", str(tmp_path / "first.npy")]) == 0
    np.testing.assert_array_equal(picture_of(tmp_path / "one.npy"), picture_of(tmp_path / "all" / "v02.npy"))
    np.testing.assert_array_equal(picture_of(tmp_path / "first.npy"), picture_of(tmp_path / "all" / "v00.npy"))
    coverage = [picture_of(tmp_path / "all" / f"v0{index}.npy")[..., 3].sum(axis=0) for index in range(3)]
    middles = [float(np.average(np.arange(40), weights=columns)) for columns in coverage]
    assert middles[0] - 2 > middles[1] > middles[2] + 2  # the cameras step to the right, the capture to the left


def test_colmap_models_are_cameras_too(capture: Path, cameras: Path, tmp_path: Path) -> None:
    """The three cameras of the JSON file as a COLMAP model: the same pictures, by index and numbered."""
    lens = Lens(1, "PINHOLE", 40, 30, (30.0, 30.0, 20.0, 15.0))
    views = [view_of(index, camera, f"{index}.png") for index, camera in enumerate(read_cameras(cameras))]
    model = write_binary(tmp_path / "ball" / "sparse" / "0", [lens], views[::-1])
    common = ["render", str(capture), "--method", "sorted", "--device", "cpu", "--quiet", "--camera"]
    assert main([*common, f"{cameras}:2", "--out", str(tmp_path / "json.npy")]) == 0
    for name, path in (("folder", tmp_path / "ball"), ("model", model), ("file", model / "images.bin")):
        assert main([*common, f"{path}:2", "--out", str(tmp_path / f"{name}.npy")]) == 0
        np.testing.assert_allclose(picture_of(tmp_path / f"{name}.npy"), picture_of(tmp_path / "json.npy"), atol=1e-5)
    assert main([*common, str(model), "--out", str(tmp_path / "all" / "v#.npy")]) == 0
    assert sorted(path.name for path in (tmp_path / "all").iterdir()) == ["v0.npy", "v1.npy", "v2.npy"]


def test_orbit_and_background(capture: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    arguments = ["render", str(capture), "--orbit", "2", "--method", "sorted", "--background", "1,0.5,0", *QUICK]
    assert main([*arguments, "--out", str(tmp_path / "o%03d.npy"), "--quiet"]) == 0
    assert capsys.readouterr() == ("", "")
    for name in ("o000.npy", "o001.npy"):
        rgba = picture_of(tmp_path / name)
        np.testing.assert_allclose(rgba[..., 3], 1.0, atol=1e-6)
        np.testing.assert_allclose(rgba[0, 0], [1, 0.5, 0, 1], atol=0.05)


def test_several_captures_share_the_scene(capture: Path, tmp_path: Path) -> None:
    """The same capture twice covers more than once: 1 − (1 − α)² where it is thin."""
    for name, files in (("one", [capture]), ("two", [capture, capture])):
        out = str(tmp_path / f"{name}.npy")
        assert main(["render", *map(str, files), "--out", out, "--method", "sorted", *QUICK]) == 0
    one, two = (picture_of(tmp_path / f"{name}.npy")[..., 3] for name in ("one", "two"))
    thin = (one > 0.2) & (one < 0.6)
    assert thin.sum() > 10
    np.testing.assert_allclose(two[thin], 1 - (1 - one[thin]) ** 2, atol=0.02)


def test_png_and_exr_are_written(capture: Path, tmp_path: Path) -> None:
    image_module = pytest.importorskip("PIL.Image")
    openexr = pytest.importorskip("OpenEXR")
    for name in ("a.png", "a.exr", "a.npy"):
        assert main(["render", str(capture), "--out", str(tmp_path / name), "--method", "sorted", *QUICK]) == 0
    with image_module.open(tmp_path / "a.png") as image, openexr.File(str(tmp_path / "a.exr")) as file:
        alpha = np.asarray(image)[..., 3] / 255
        rgba, depth = file.channels()["RGBA"].pixels, file.channels()["Depth.Z"].pixels
    expected = picture_of(tmp_path / "a.npy")[..., 3]
    np.testing.assert_allclose(alpha, expected, atol=0.51 / 255)
    np.testing.assert_array_equal(rgba[..., 3], expected)
    assert 1 < depth[16, 24] < 5 and depth.max() == np.float32(1e10)


def test_interrupting_ends_with_130_and_leaves_whole_files(capture: Path, tmp_path: Path) -> None:
    """Ctrl-C after the first of very many pictures."""
    command = [sys.executable, "-m", "stipple.engine.cli", "render", str(capture), *QUICK]
    command += ["--out", str(tmp_path / "####.npy"), "--orbit", "3000", "--samples", "2"]
    # A shell that started this test in the background has SIGINT ignored, and the child would inherit that.
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    signal.signal(signal.SIGINT, before)
    assert process.stdout is not None
    first = process.stdout.readline()
    process.send_signal(signal.SIGINT)
    _, errors = process.communicate(timeout=30)
    assert "0000.npy" in first, errors
    assert process.returncode == 130
    assert "cancelled" in errors and "Traceback" not in errors
    written = list(tmp_path.iterdir())
    assert 0 < len(written) < 3000
    assert all(path.suffix == ".npy" and picture_of(path).shape == (32, 48, 4) for path in written)
