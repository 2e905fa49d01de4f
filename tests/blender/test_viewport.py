# SPDX-License-Identifier: GPL-3.0-or-later
"""Viewport sessions and their thread, driven without a window."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import pairwise
from typing import Any

import bpy
import numpy as np
import pytest

from stipple.addon import residency, sync, viewport
from stipple.addon.residency import CloudCache, EvaluatedClouds
from stipple.addon.view_camera import ViewportView
from stipple.addon.viewport import Aim, ViewportSession
from stipple.addon.viewport_worker import THREAD_NAME
from stipple.engine.renderer import Renderer
from stipple.engine.scene import Instance, Scene
from stipple.engine.settings import Settings
from tests.light import light_of

from .captures import add_capture, random_cloud, use_stipple

pytestmark = pytest.mark.blender

WINDOW = ((2.0, 0.0, 0.0, 0.0), (0.0, 3.0, 0.0, 0.0), (0.0, 0.0, -1.002, -0.2002), (0.0, 0.0, -1.0, 0.0))
ALONG_Y = ((1.0, 0.0, 0.0, 0.0), (0.0, 0.0, -1.0, 0.0), (0.0, 1.0, 0.0, 4.0))


def aim(cloud: Any = None, shift: float = 0.0, method: str = "sorted", samples: int = 4) -> Aim:
    rows = ((1.0, 0.0, 0.0, shift), *ALONG_Y[1:])
    settings = Settings(method=method, samples=samples, device="cpu")
    scene = Scene((Instance(cloud or random_cloud()),), (0.1, 0.2, 0.3))
    return Aim(scene, ViewportView(WINDOW, rows, 90, 60), settings, "Rec.709")


def never() -> bool:
    return False


@pytest.fixture(scope="module")
def renderer() -> Iterator[Renderer]:
    made = Renderer("cpu")
    yield made
    made.free()


def run(session: ViewportSession, renderer: Renderer) -> list[tuple[int, int]]:
    """Steps until there is nothing to do: (divider, samples) of every picture shown."""
    shown = []
    while (due := session.due()) is not None:
        time.sleep(due)
        before = session.picture
        session.step(renderer, never)
        if session.picture is not None and session.picture is not before:
            assert session.take() is session.picture
            shown.append((session.picture.divider, session.picture.samples))
    return shown


def wait_for(condition: Callable[[], bool], seconds: float = 60.0) -> None:
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, "waited in vain"
        time.sleep(0.01)


@pytest.mark.parametrize("method", ["sorted", "points"])
def test_a_resting_viewport_ends_at_the_renderers_own_picture(renderer: Renderer, method: str) -> None:
    target = aim(method=method)
    session = ViewportSession(lambda: None)
    session.aim_at(target)
    shown = run(session, renderer)
    limit = 1 if method == "sorted" else 4
    assert shown[0] == (4, 1) and shown[-1] == (1, limit)
    assert session.due() is None and session.message == ""
    expected = renderer.render(target.scene, target.view.camera(), target.settings)
    assert session.picture is not None
    np.testing.assert_array_equal(session.picture.rgba, light_of(expected.rgba))
    assert f"Sample {limit}/{limit} | {expected.stats.splats_visible:,} splats" in session.status()


def test_a_picture_that_a_redraw_waits_for_asks_for_no_second_one(
    renderer: Renderer, monkeypatch: pytest.MonkeyPatch
) -> None:
    """While Blender redraws its window keys wait, for 0.1 s without a graphics card."""
    monkeypatch.setattr(viewport, "WAIT", 60.0)
    monkeypatch.setattr(viewport, "LONGEST_WAIT", 60.0)
    asked: list[float] = []
    session = ViewportSession(lambda: asked.append(time.monotonic()))
    session.aim_at(aim())
    worker = threading.Timer(0.1, session.step, (renderer, never))
    worker.start()
    session.wait_a_moment()  # in a redraw, which takes the picture next
    worker.join()
    assert session.take() is not None and asked == []
    shown = run(session, renderer)
    assert shown == [(1, 1)] and len(asked) == 1  # nobody waited for the full size


def test_the_small_picture_is_the_same_view(renderer: Renderer) -> None:
    session = ViewportSession(lambda: None)
    target = aim(random_cloud(size=0.2))  # far larger than the pixels that the dilation blurs
    session.aim_at(replace(target, view=replace(target.view, width=88)))
    session.step(renderer, never)
    small = session.picture
    run(session, renderer)
    full = session.picture
    assert small is not None and full is not None and small.rgba.shape == (15, 22, 4) and small.place == full.place
    coarse = full.rgba.reshape(15, 4, 22, 4, 4).mean(axis=(1, 3))
    assert np.corrcoef(coarse[..., 0].ravel(), small.rgba[..., 0].ravel())[0, 1] > 0.97


@pytest.mark.parametrize(
    "change",
    [
        lambda a: replace(a, view=replace(a.view, camera_from_world=((1.0, 0.0, 0.0, 0.3), *ALONG_Y[1:]))),
        lambda a: replace(a, view=replace(a.view, width=70)),
        lambda a: replace(a, settings=replace(a.settings, sh_degree=0)),
        lambda a: replace(a, scene=Scene(a.scene.instances, None)),
    ],
    ids=["camera", "size", "settings", "background"],
)
def test_every_change_is_shown_and_nothing_else_renders(renderer: Renderer, change: Callable[[Aim], Aim]) -> None:
    session = ViewportSession(lambda: None)
    target = aim()
    session.aim_at(target)
    run(session, renderer)
    before = session.picture
    assert before is not None
    assert not session.aim_at(replace(target)) and run(session, renderer) == []
    assert session.aim_at(change(target)) and session.due() is not None
    run(session, renderer)
    assert session.picture is not None
    if session.picture.rgba.shape == before.rgba.shape:
        assert np.abs(session.picture.rgba - before.rgba).max() > 0.01


def test_a_drag_shows_pictures_all_the_way(renderer: Renderer) -> None:
    """The aim changes during every single launch, and still each step brings a picture."""
    session = ViewportSession(lambda: None)
    cloud = random_cloud()
    for index in range(5):
        session.aim_at(aim(cloud, 0.1 * index))
        before = session.picture
        thread = threading.Timer(0.001, session.aim_at, [aim(cloud, 0.1 * index + 0.05)])
        thread.start()
        session.step(renderer, never)
        thread.join()
        assert session.picture is not before


def test_a_problem_is_shown_and_the_next_view_works(renderer: Renderer) -> None:
    session = ViewportSession(lambda: None)
    target = aim()
    session.aim_at(target)
    session.fail(target, "There is no memory.")
    assert session.due() is None and session.status() == "There is no memory."
    session.aim_at(aim(shift=0.2))
    run(session, renderer)
    assert session.status().startswith("Sample 1/1")


def test_samples_that_add_up_are_shown_and_not_talked_about(
    renderer: Renderer, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(viewport, "LONG", -1.0)
    monkeypatch.setattr(viewport, "SAY_INTERVAL", -1.0)
    said: list[str] = []
    session = ViewportSession(lambda: said.append(session.status()))
    session.aim_at(aim(method="points", samples=20))
    run(session, renderer)
    first = next(index for index, text in enumerate(said) if text.startswith("Sample 1/20"))
    assert any(text.startswith("Loading") for text in said[:first])  # words for what has no picture yet
    assert all(text.startswith("Sample") for text in said[first:])
    assert len(said) - first <= 6  # and few redraws, which keys wait for: at 1, 2, 4, 8, 16 and 20 on a slow machine


@pytest.mark.parametrize("method", ["points", "sorted"])
@pytest.mark.parametrize("redraw", [0.003, 0.126])
def test_redraws_hold_up_few_keys(
    renderer: Renderer, monkeypatch: pytest.MonkeyPatch, method: str, redraw: float
) -> None:
    """A minute of samples (sorted has 26 s of them), a tenth of a second each by a clock of the test's own."""
    now = [1000.0]
    monkeypatch.setattr(viewport.time, "monotonic", lambda: now[0])
    monkeypatch.setattr(viewport, "SLOW", float("inf"))  # no smaller pictures, however long the kernels take to load
    target = aim(method=method, samples=600)
    target = replace(target, settings=replace(target.settings, supersampling=16 if method == "sorted" else 1))
    session = ViewportSession(lambda: None)
    session.redraw_seconds, session.divider = redraw, 1
    session.aim_at(target)
    shown = []
    while session.due() is not None:
        now[0] += 0.1
        before = session.picture
        session.step(renderer, never)
        if session.picture is not before:
            session.take()
            assert session.picture is not None
            shown.append((now[0] - 1000.0, session.picture.samples))
    assert shown[0][1] == 1 and shown[-1][1] == (600 if method == "points" else 256)
    growth = 2 if redraw < 0.04 else 4
    assert all(after >= growth * before for (_, before), (_, after) in pairwise(shown[:-1]))
    if redraw < 0.04:  # a graphics card: nothing waits, and the picture is renewed whenever it is twice as good
        assert [samples for _, samples in shown[:-1]] == [2**k for k in range(len(shown) - 1)]
        return
    assert method == "sorted" or shown[1][0] < 0.7  # most of the noise goes early
    held_up = (len(shown) - 2) * (redraw - 0.04)  # the first and the last are what the user waits for
    assert held_up < 0.005 * shown[-1][0]


def test_several_viewports_take_turns_and_leave_no_thread() -> None:
    def threads() -> int:
        return sum(thread.name == THREAD_NAME for thread in threading.enumerate())

    redraws: list[int] = []
    cloud = random_cloud()
    sessions = [ViewportSession(lambda index=index: redraws.append(index)) for index in range(3)]  # type: ignore[misc]
    for index, session in enumerate(sessions):
        session.aim_at(aim(cloud, 0.1 * index, "points"))
        residency.worker.add(session)
    wait_for(lambda: all(s.due() is None for s in sessions))
    assert threads() == 1 and set(redraws) == {0, 1, 2}
    sessions[0].close()
    residency.worker.wake()
    wait_for(lambda: len(residency.worker._sessions) == 2)
    residency.free()
    assert threads() == 0 and not residency.worker.running
    assert all(session.closed for session in sessions)
    assert not [t.name for t in threading.enumerate() if t.name.startswith("stipple")]


def test_a_final_render_stops_the_viewport_and_gives_it_back() -> None:
    session = ViewportSession(lambda: None)
    session.aim_at(aim(method="points", samples=2000))
    residency.worker.add(session)
    wait_for(lambda: session.picture is not None and session.picture.divider == 1)
    with residency.worker.final_render(lambda: None):
        held = session.picture
        time.sleep(0.2)
        assert session.picture is held
    wait_for(lambda: session.picture is not held)
    residency.free()


def test_only_changed_captures_are_read_again() -> None:
    use_stipple()
    b_object, b_other = add_capture(random_cloud(), "A"), add_capture(random_cloud(seed=2), "B")
    cache = CloudCache()
    known = EvaluatedClouds(cache)
    reads: list[str] = []

    def read(changed: set[int]) -> list[Any]:
        b_depsgraph = bpy.context.evaluated_depsgraph_get()
        clouds = []
        reads.clear()
        original = cache.cloud_of
        cache.cloud_of = lambda b_data, name: (reads.append(name), original(b_data, name))[1]  # type: ignore[method-assign]
        with known.reading(changed):
            for b_instance in b_depsgraph.object_instances:
                b_evaluated = b_instance.object
                uids = [b_id.original.session_uid for b_id in (b_evaluated, b_evaluated.data)]
                clouds.append(known.cloud_of(b_evaluated.data, b_evaluated.name, uids)[0])
        del cache.cloud_of  # type: ignore[method-assign]
        return clouds

    first = read(set())
    assert sorted(reads) == ["A", "B"]
    b_object.location.x = 2
    bpy.context.view_layer.update()
    assert read(set()) == first and reads == []
    assert read({b_other.session_uid}) == first and reads == ["B"]


def test_clouds_in_use_are_found_again_after_the_cache_dropped_them() -> None:
    use_stipple()
    add_capture(random_cloud())
    cache = CloudCache()
    scene, _ = sync.scene_from_depsgraph(bpy.context.evaluated_depsgraph_get(), cache)
    cache.free()
    again, _ = sync.scene_from_depsgraph(bpy.context.evaluated_depsgraph_get(), cache)
    assert again.instances[0].cloud is scene.instances[0].cloud


def test_the_viewport_has_its_own_number_of_samples() -> None:
    b_scene = use_stipple(method="POINTS")
    b_scene.stipple.viewport_samples = 7
    final, viewport = sync.settings_from_scene(b_scene), sync.viewport_settings(b_scene)
    assert (final.samples, viewport.samples) == (4, 7)
    assert replace(viewport, samples=4) == final
