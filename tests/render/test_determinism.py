# SPDX-License-Identifier: GPL-3.0-or-later
"""Equal keys give equal bits, whatever the number of threads, the buffers left over, or the order of frames."""

from __future__ import annotations

import gc
from collections.abc import Iterator
from itertools import pairwise

import numpy as np
import pytest

from stipple.engine import device as engine_device
from stipple.engine.errors import Cancelled, StippleError
from stipple.engine.renderer import Frame, Renderer
from stipple.engine.settings import Settings
from stipple.engine.sorted.method import FRAGMENTS_PER_LAUNCH
from tests.light import light_of
from tests.scenes import cloud_of, front_camera, random_cloud, scene_of

METHODS = ("points", "sorted")


@pytest.fixture
def threads() -> Iterator[None]:
    before = engine_device.thread_count()
    yield
    engine_device.set_thread_count(before)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.usefixtures("threads")
def test_threads_change_no_bit(renderer: Renderer, method: str) -> None:
    scene = scene_of(random_cloud(3000, 1, sigma_px=(0.5, 6.0), sh_degree=3))
    settings = Settings(method=method, samples=4, supersampling=2)
    pictures = []
    for count in (1, 2, 7):
        engine_device.set_thread_count(count)
        pictures.append(renderer.render(scene, front_camera(320, 240), settings))
    for other in pictures[1:]:
        assert np.array_equal(pictures[0].rgba, other.rgba)
        assert np.array_equal(pictures[0].depth, other.depth)


@pytest.mark.parametrize("method", METHODS)
def test_other_frames_in_between_change_no_bit(renderer: Renderer, method: str) -> None:
    scene = scene_of(random_cloud(300, 1))
    settings = Settings(method=method, samples=3)
    first = renderer.render(scene, front_camera(), settings).rgba
    renderer.render(scene_of(random_cloud(900, 2)), front_camera(200, 160), Settings(samples=2, supersampling=3))
    assert np.array_equal(first, renderer.render(scene, front_camera(), settings).rgba)


def test_seeds_and_samples_differ(renderer: Renderer) -> None:
    scene = scene_of(random_cloud(300, 1))
    pictures = [renderer.render(scene, front_camera(), Settings(samples=1, seed=seed)).rgba for seed in (0, 1)]
    assert (pictures[0] != pictures[1]).mean() > 0.2
    frame = Frame(renderer, scene, front_camera(), Settings(samples=2))
    frame.render_sample(1)
    assert not np.array_equal(frame.resolve().rgba, pictures[0])


@pytest.mark.parametrize("reprojection", [False, True])
def test_light_is_the_pictures_and_changes_no_later_one(renderer: Renderer, device: str, reprojection: bool) -> None:
    """Light is made in the memory of the film: looking at a frame in progress leaves its sums and the history alone."""
    scene = scene_of(random_cloud(300, 1), background=(0.2, 0.3, 0.4))
    settings = Settings(samples=2, reprojection=reprojection)
    seen = []
    for as_light in ((False, False), (False, True), (True, True)):
        renderer.history.forget()
        frame = Frame(renderer, scene, front_camera(61, 47), settings)
        for sample in range(2):
            frame.render_sample(sample)
            last = frame.resolve_light("ACEScg") if as_light[sample] else frame.resolve()
        seen.append((last.rgba.copy(), last.depth.copy()))
    rgba, depth = seen[0]
    for light, light_depth in seen[1:]:
        assert np.array_equal(light, light_of(rgba, "ACEScg", device))
        assert np.array_equal(light_depth, depth[::-1])


@pytest.mark.parametrize("method", METHODS)
def test_cancel_leaves_a_usable_renderer(renderer: Renderer, method: str) -> None:
    scene, settings = scene_of(random_cloud(300, 1)), Settings(method=method, samples=4)
    wanted = renderer.render(scene, front_camera(), settings).rgba
    calls = 0

    def stop(fraction: float, text: str) -> None:
        nonlocal calls
        calls += 1
        assert 0.0 <= fraction <= 1.0 and text
        if calls == 3:
            raise Cancelled

    with pytest.raises(Cancelled):
        renderer.render(scene, front_camera(), settings, stop)
    assert calls == 3
    assert np.array_equal(wanted, renderer.render(scene, front_camera(), settings).rgba)


def test_crowded_frames_ask_the_host_often(renderer: Renderer) -> None:
    """Faint splats that all cover the frame: no launch may blend more than a third of a second's work."""
    cloud = cloud_of(np.column_stack([np.zeros((60, 2)), np.linspace(3, 6, 60)]), 50.0, 0.02, (1, 1, 1))
    frame = Frame(renderer, scene_of(cloud), front_camera(3840, 2160), Settings(method="sorted"))
    fragments = 60 * 240 * 135
    ranges = frame.method._row_ranges  # type: ignore[attr-defined]
    assert ranges[0][0] == 0 and ranges[-1][1] == 135
    assert all(before[1] == after[0] for before, after in pairwise(ranges))
    assert len(ranges) >= fragments / FRAGMENTS_PER_LAUNCH


def test_clouds_leave_with_their_scene(device: str) -> None:
    renderer = Renderer(device)
    for seed in range(4):
        renderer.render(scene_of(random_cloud(100, seed)), front_camera(), Settings(samples=1))
        gc.collect()
        assert len(renderer._clouds) == 1
    renderer.free()
    assert renderer.buffers.held_bytes == 0


def test_memory_is_added_up_before_anything_is_taken(renderer: Renderer, monkeypatch: pytest.MonkeyPatch) -> None:
    """A film's sums alone would fit here; with their mean, the host's copy and a visibility buffer they do not."""
    scene, whole = scene_of(random_cloud(30, 1)), Settings(method="sorted")
    renderer.free()
    monkeypatch.setattr("stipple.engine.buffers.free_bytes", lambda device: 60 * 1000 * 1000)
    for settings in (whole, Settings(samples=1, supersampling=4)):
        with pytest.raises(StippleError, match=r"are needed for a picture of 1000×1000 px"):
            renderer.render(scene, front_camera(1000, 1000), settings)
    assert renderer.render(scene, front_camera(700, 700), whole).rgba.any()
    # What the film holds is no room for a visibility buffer of 63 MB; for the same film again it is.
    with pytest.raises(StippleError, match="are needed for"):
        renderer.render(scene, front_camera(700, 700), Settings(samples=1, supersampling=4))
    monkeypatch.setattr("stipple.engine.buffers.free_bytes", lambda device: 12 * 1000 * 1000)
    assert renderer.render(scene, front_camera(700, 700), whole).rgba.any()


def test_too_little_memory_is_one_sentence_with_numbers(renderer: Renderer, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("stipple.engine.buffers.free_bytes", lambda device: 1 << 20)
    renderer.free()
    scene = scene_of(random_cloud(300, 1))
    with pytest.raises(StippleError, match=r"GiB are needed for .* and 0\.00 GiB are free; render fewer"):
        renderer.render(scene, front_camera(2000, 1500), Settings(samples=1, supersampling=2))
    monkeypatch.undo()
    assert renderer.render(scene, front_camera(), Settings(samples=1)).rgba.any()


def test_unknown_device_names_those_there_are() -> None:
    with pytest.raises(StippleError, match="choose one of cpu"):
        Renderer("cuda:99")
