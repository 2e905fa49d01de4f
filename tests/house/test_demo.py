# SPDX-License-Identifier: GPL-3.0-or-later
"""The demo, made small: from a file to frames and a video."""

from __future__ import annotations

import os
import subprocess
import sys
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from stipple.engine.formats import write_splats
from stipple.engine.splats import SplatCloud

pytestmark = [pytest.mark.blender, pytest.mark.slow]


def coloured_ball(splat_count: int = 400) -> SplatCloud:
    rng = np.random.default_rng(5)
    direction = rng.normal(size=(splat_count, 3))
    position = direction / np.linalg.norm(direction, axis=1, keepdims=True)
    return SplatCloud(
        position=np.ascontiguousarray(position, np.float32),
        scale=np.full((splat_count, 3), 0.08, np.float32),
        rotation=np.tile(np.array([1, 0, 0, 0], np.float32), (splat_count, 1)),
        opacity=np.full(splat_count, 0.9, np.float32),
        sh_dc=np.ascontiguousarray(2 * position, np.float32),
        sh_rest=np.zeros((splat_count, 0, 3), np.float32),
    )


def run_demo(root: Path, *arguments: object) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, root / "scripts" / "demo.py", *map(str, arguments)]
    environment = dict(os.environ)  # and not what a bpy in this process has set with putenv
    return subprocess.run(command, check=False, capture_output=True, text=True, env=environment)


def test_frames_and_video_are_made(root: Path, tmp_path: Path) -> None:
    from PIL import Image

    capture, output = tmp_path / "ball.ply", tmp_path / "out"
    write_splats(capture, coloured_ball())
    result = run_demo(root, capture, "--output", output, "--frames", 4, "--size", "160x90")
    assert result.returncode == 0, result.stdout + result.stderr
    assert [line for line in result.stdout.splitlines() if not line.startswith("demo: ")] == []
    frames = [np.asarray(Image.open(file), dtype=int) for file in sorted(output.glob("frame-*.png"))]
    assert [frame.shape for frame in frames] == [(90, 160, 3)] * 4
    assert all(np.abs(a - b).mean() > 1 for a, b in pairwise(frames)), "the camera does not move"
    for frame in frames:  # the ball is in the middle of every frame, and the backdrop around it
        colourful = np.ptp(frame, axis=2) > 60
        assert 0.1 < colourful.mean() < 0.7
        assert not colourful[:, :10].any() and not colourful[:, -10:].any()
    assert (output / "demo.mp4").read_bytes()[4:8] == b"ftyp"


def test_a_file_that_is_no_capture_is_named_in_one_line(root: Path, tmp_path: Path) -> None:
    wrong = tmp_path / "wrong.ply"
    wrong.write_text("not a capture")
    result = run_demo(root, wrong, "--output", tmp_path / "out")
    assert result.returncode == 1
    assert "wrong.ply" in result.stderr.splitlines()[-1] and "Traceback" not in result.stderr
    assert not list((tmp_path / "out").glob("frame-*.png"))
