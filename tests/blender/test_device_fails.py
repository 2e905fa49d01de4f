# SPDX-License-Identifier: GPL-3.0-or-later
"""A device that is full, missing or fails: the CPU takes over, with a sentence, and the picture is the same.

Where there is no GPU, "cuda:0" here is the CPU under another name: everything but the choice of the device is real.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import warp as wp

from stipple.addon import residency
from stipple.addon.viewport import ViewportSession
from stipple.engine import buffers
from stipple.engine import device as engine_device

from .captures import add_camera, add_capture, random_cloud, render, use_stipple
from .test_viewport import aim, wait_for

pytestmark = pytest.mark.blender
GPU = "cuda:0"


@pytest.fixture
def gpu(monkeypatch: pytest.MonkeyPatch) -> Iterator[str]:
    """A device besides the CPU that the renderer can be asked for."""
    if not wp.is_cuda_available():
        choose = engine_device.choose_device

        def choose_here(name: str = "auto") -> wp.Device:
            return choose("cpu" if name == GPU else name)

        for module in ("engine.device", "engine.renderer"):
            monkeypatch.setattr(f"stipple.{module}.choose_device", choose_here)
    yield GPU
    residency.free()


@pytest.fixture
def small(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(buffers.allocation_limits, GPU, 100_000)


def scene_on_gpu(method: str = "SORTED") -> Any:
    b_scene = use_stipple(method=method)
    add_camera()
    add_capture(random_cloud())
    b_scene.stipple.device = "CUDA"
    return b_scene


def cpu_picture(tmp_path: Path, b_scene: Any) -> np.ndarray:
    b_scene.stipple.device = "CPU"
    picture = render(tmp_path / "cpu.exr")
    b_scene.stipple.device = "CUDA"
    return picture


@pytest.mark.parametrize("method", ["SORTED", "POINTS"])
@pytest.mark.usefixtures("gpu", "small")
def test_a_full_device_gives_way_to_the_cpu(tmp_path: Path, capfd: pytest.CaptureFixture[str], method: str) -> None:
    b_scene = scene_on_gpu(method)
    wanted = cpu_picture(tmp_path, b_scene)
    capfd.readouterr()
    np.testing.assert_array_equal(render(tmp_path / "frame.exr"), wanted)
    printed = "".join(capfd.readouterr())
    assert "MiB" in printed or "GiB are needed" in printed
    assert "The CPU renders instead." in printed


@pytest.mark.usefixtures("gpu")
def test_a_device_that_has_room_again_is_used_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    scene_on_gpu()
    with monkeypatch.context() as only_here:
        only_here.setitem(buffers.allocation_limits, GPU, 100_000)
        render(tmp_path / "full.exr")
    assert list(residency._renderers) == ["cpu"]
    capfd.readouterr()
    render(tmp_path / "free.exr")
    assert list(residency._renderers) == [GPU] and "instead" not in "".join(capfd.readouterr())


@pytest.mark.usefixtures("gpu", "small")
def test_the_cpu_has_nothing_to_fall_back_to(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(buffers.allocation_limits, "cpu", 100_000)
    scene_on_gpu()
    with pytest.raises(RuntimeError, match="render fewer splats, a smaller picture") as caught:
        render(tmp_path / "frame.exr")
    assert "Traceback" not in str(caught.value) and not (tmp_path / "frame.exr").exists()


def test_a_missing_device_gives_way_to_the_cpu(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    if wp.is_cuda_available():
        pytest.skip("this machine has the device")
    b_scene = scene_on_gpu()
    wanted = cpu_picture(tmp_path, b_scene)
    capfd.readouterr()
    np.testing.assert_array_equal(render(tmp_path / "frame.exr"), wanted)
    assert "device 'cuda:0' is not on this machine" in "".join(capfd.readouterr())


@pytest.mark.usefixtures("gpu")
def test_a_device_that_fails_is_not_asked_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    """Warp's launches fail as they do after CUDA reported an error, in the middle of a frame and from then on."""
    b_scene = scene_on_gpu("POINTS")
    wanted = cpu_picture(tmp_path, b_scene)
    launches: list[str] = []
    launch = wp.launch

    def launch_on_a_lost_device(*arguments: Any, **options: Any) -> Any:
        if GPU in residency._renderers:
            launches.append(GPU)
            if len(launches) > 10:
                raise RuntimeError("CUDA error 719: unspecified launch failure")
        return launch(*arguments, **options)

    monkeypatch.setattr(wp, "launch", launch_on_a_lost_device)
    b_scene.frame_end = 2
    for name in ("one", "two"):
        capfd.readouterr()
        np.testing.assert_array_equal(render(tmp_path / f"{name}.exr"), wanted)
        printed = "".join(capfd.readouterr())
        assert "cuda:0 failed (CUDA error 719" in printed and "The CPU renders instead." in printed
    assert len(launches) == 11


@pytest.mark.usefixtures("gpu")
def test_a_viewport_goes_on_with_the_cpu(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(buffers.allocation_limits, GPU, 100_000)
    from dataclasses import replace

    target = aim()
    session = ViewportSession(lambda: None)
    session.aim_at(replace(target, settings=replace(target.settings, device=GPU)))
    residency.worker.add(session)
    wait_for(lambda: session.due() is None)
    assert session.picture is not None and session.picture.divider == 1
    assert session.status().startswith("Sample 1/1") and session.status().endswith("The CPU renders instead.")
    session.aim_at(target)
    residency.worker.wake()
    wait_for(lambda: session.due() is None)
    assert session.notice == ""
    monkeypatch.delitem(buffers.allocation_limits, GPU)
    session.aim_at(replace(target, settings=replace(target.settings, device=GPU, seed=1)))
    residency.worker.wake()
    wait_for(lambda: session.due() is None)
    time.sleep(0.05)
    assert residency.worker._renderers[id(session)][0] == GPU and session.notice == ""
