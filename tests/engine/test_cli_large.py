# SPDX-License-Identifier: GPL-3.0-or-later
"""The command on captures that are larger than it wants to hold in memory."""

from __future__ import annotations

import json
import os
from pathlib import Path

import numpy as np
import pytest

from stipple.engine.capture_file import CaptureFile
from stipple.engine.cli import main
from stipple.engine.edit.capture_edits import CaptureEdits, identity_of
from stipple.engine.edit.edits_file import write_edits
from stipple.engine.edit.state_bits import DELETED, SELECTED
from stipple.engine.formats import read_splats
from tests.capture_files import run_python, write_large
from tests.stats.image_metrics import psnr

VIEW = ["--size", "160x120", "--method", "sorted", "--device", "cpu"]


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return write_large(tmp_path / "garden.ply", 30_000, 3)


def test_a_capture_rendered_from_its_file_looks_as_from_memory(path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    pictures = []
    for limit in (0, 30_000):
        out = path.with_name(f"{limit}.npy")
        assert main(["render", str(path), "--out", str(out), "--stream-above", str(limit), *VIEW]) == 0
        pictures.append(np.load(out))
        said = capfd.readouterr().err
        assert ("30,000 splats, 2.76 MB, stays in its file; 1.35 MB on the device" in said) == (limit == 0)
    assert pictures[1].std() > 0.05
    assert 45 < psnr(*pictures) < 90  # the same, and from quantised splats


def test_quiet_says_nothing_about_sizes(path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    out = path.with_suffix(".png")
    assert main(["render", str(path), "--out", str(out), "--stream-above", "0", "--quiet", *VIEW]) == 0
    assert capfd.readouterr() == ("", "")


def test_info_of_a_large_capture_holds_no_more_than_a_sample(
    path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    assert main(["info", str(path), "--json"]) == 0
    exact = json.loads(capfd.readouterr().out)
    cloud = read_splats(path).cloud
    assert exact["opacity"]["p50"] == pytest.approx(float(np.median(cloud.opacity)))
    assert (exact["host_bytes"], exact["device_bytes"]) == (cloud.nbytes, 30_000 * (16 + 1 + 12 + 4 + 12))
    monkeypatch.setattr("stipple.engine.cli_info.SAMPLED_SPLATS", 1_000)
    monkeypatch.setattr("stipple.engine.formats.splat_source.CHUNK_BYTES", 100_000)
    assert main(["info", str(path), "--json"]) == 0
    sampled = json.loads(capfd.readouterr().out)
    for key in ("splats", "bounds", "dropped", "host_bytes"):
        assert sampled[key] == exact[key]
    assert sampled["opacity"]["p50"] == pytest.approx(float(np.median(cloud.opacity[::30])))


INTERRUPTED = """
import os, signal, sys
from stipple.engine import capture_upload, cli
load = capture_upload._from_file
def interrupted(capture, device, progress, share):
    def report(fraction, text):
        progress(fraction, text)
        if "(2/2)" in text and fraction > 0.7:
            os.kill(os.getpid(), signal.SIGINT)
    return load(capture, device, report, share)
capture_upload._from_file = interrupted
sys.exit(0 if cli.main(sys.argv[1:]) == 130 else 1)
"""


@pytest.mark.skipif(not hasattr(os, "kill") or os.name == "nt", reason="no signals")
def test_ctrl_c_while_a_capture_is_read_leaves_nothing_behind(tmp_path: Path) -> None:
    path = write_large(tmp_path / "garden.ply", 300_000, 15)
    assert CaptureFile.open(path).fingerprint.file_bytes > CaptureFile.open(path).places.smallest_bytes
    arguments = ["render", path, "--out", tmp_path / "a.png", "--stream-above", 0, *VIEW]
    run_python(INTERRUPTED, *arguments, STIPPLE_CACHE="beside")
    assert os.listdir(tmp_path) == ["garden.ply"]


def test_edits_are_applied_to_a_copy(path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    capture = CaptureFile.open(path)
    states = np.zeros(30_000, np.uint32)
    states[:10_000], states[20_000:25_000] = DELETED, SELECTED
    edits = path.with_name("shot.garden.edits.npz")
    write_edits(edits, CaptureEdits(identity_of(capture.fingerprint), 30_000).with_states(states), "garden.ply", 3)
    copy = path.with_name("copy.ply")
    assert main(["apply", str(path), str(edits), "--out", str(copy)]) == 0
    assert f"{copy}: 20,000 splats" in capfd.readouterr().err
    kept = read_splats(path).cloud.position[10_000:]
    assert np.array_equal(read_splats(copy).cloud.position, kept)
    assert main(["apply", str(path), str(edits), "--out", str(copy), "--selected", "--quiet"]) == 0
    assert capfd.readouterr().err == "" and np.array_equal(read_splats(copy).cloud.position, kept[10_000:15_000])
    before = sorted(os.listdir(path.parent))
    for arguments, reason in (
        ([path, edits, "--out", path], "this is the capture itself"),
        ([path, path, "--out", copy], "the edits are damaged"),
        ([copy, edits, "--out", copy.with_name("more.ply")], "made on a file of other content"),
        ([path, edits, "--out", copy.with_suffix(".spz")], "is not known"),
    ):
        assert main(["apply", *map(str, arguments)]) == 1
        assert reason in capfd.readouterr().err
    assert sorted(os.listdir(path.parent)) == before
