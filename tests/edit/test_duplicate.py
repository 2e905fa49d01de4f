# SPDX-License-Identifier: GPL-3.0-or-later
"""Splats added and taken away: duplicate, clone, join, separate, merge; and captures aligned by points."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from stipple.engine.edit.affine import composed, inverse, rotation, scaling, translation
from stipple.engine.edit.align import align_points
from stipple.engine.edit.brush import Brush
from stipple.engine.edit.duplicate import CloneStroke, append_cloud, duplicate, merge_clouds, separate
from stipple.engine.edit.editable_cloud import EditableCloud
from stipple.engine.edit.flags import counts, restore
from stipple.engine.edit.history import History
from stipple.engine.edit.match_values import match_opacity
from stipple.engine.edit.paint_stroke import PaintStroke
from stipple.engine.edit.selection import select, select_all
from stipple.engine.edit.transform import transform, transform_cloud
from stipple.engine.errors import StippleError
from stipple.engine.splats import ARRAY_NAMES, SplatCloud
from tests.edit.every_byte import assert_same, every_byte
from tests.scenes import random_cloud

Clouds = Callable[..., EditableCloud]

MOVE = composed(translation((3, 0, 0)), rotation((0, 1, 0), 0.5))


def assert_rows(cloud: SplatCloud, rows: slice | np.ndarray, wanted: SplatCloud) -> None:
    for name in ARRAY_NAMES:
        np.testing.assert_array_equal(getattr(cloud, name)[rows], getattr(wanted, name), err_msg=name)


def there_and_back(history: History, step_makes: Callable[[], object]) -> None:
    """Do, undo, redo and undo, comparing every byte."""
    cloud = history.cloud
    before = every_byte(cloud)
    history.do(step_makes())
    after = every_byte(cloud)
    for _ in range(2):
        history.undo()
        assert_same(cloud, before)
        history.redo()
        assert_same(cloud, after)


@pytest.mark.parametrize("painted", [False, True])
def test_duplicate(make_cloud: Clouds, painted: bool) -> None:
    cloud = make_cloud(500, 1, 2)
    history = History(cloud)
    if painted:
        stroke = PaintStroke(cloud, Brush("hue_saturation", (0.2, 0.9, 0.1), strength=0.7))
        stroke.dab((0, 0, 4), 2.0)
        history.record(stroke.finish())
    history.do(select(cloud, match_opacity(cloud, 0.7)))
    originals = cloud.to_cloud(cloud.selection())
    there_and_back(history, lambda: duplicate(cloud, MOVE))
    copies = cloud.to_cloud(cloud.selection())
    assert cloud.splat_count == 500 + originals.splat_count
    assert np.flatnonzero(cloud.selection().numpy()).min() == 500
    moved = transform_cloud(originals, MOVE)
    for name in ARRAY_NAMES:
        np.testing.assert_allclose(getattr(copies, name), getattr(moved, name), atol=1e-6, err_msg=name)
    assert history.undo_step.nbytes < 2 * 500 / 8 + 200
    there_and_back(history, lambda: duplicate(cloud))
    there_and_back(history, lambda: transform(cloud, MOVE))
    before = every_byte(cloud)
    history.go_to(0)
    assert cloud.splat_count == 500
    history.go_to(history.last_position)
    assert_same(cloud, before)


@pytest.mark.parametrize(("own", "other"), [(2, 2), (1, 3), (4, 0), (0, 2)])
@pytest.mark.parametrize("painted", [False, True])
def test_join_captures_of_different_degree(make_cloud: Clouds, own: int, other: int, painted: bool) -> None:
    cloud, added = make_cloud(300, 1, own), random_cloud(200, 2, sh_degree=other)
    history = History(cloud)
    if painted:
        for mode in ("rgb", "opacity"):
            stroke = PaintStroke(cloud, Brush(mode, opacity=0.1))
            stroke.dab((0, 0, 4), 2.0)
            history.record(stroke.finish())
    first = cloud.to_cloud()
    there_and_back(history, lambda: append_cloud(cloud, added))
    joined = cloud.to_cloud()
    assert joined.sh_degree == max(own, other)
    wanted = merge_clouds([first, added])
    assert_rows(joined, slice(None), wanted)
    assert not wanted.sh_rest[:300, first.sh_rest.shape[1] :].any()
    np.testing.assert_array_equal(cloud.selection().numpy(), np.arange(500) >= 300)
    there_and_back(history, lambda: transform(cloud, MOVE))
    stroke = PaintStroke(cloud, Brush("erase"))
    stroke.dab((3, 0, 3), 3.0)
    step = stroke.finish()
    if step is not None:
        history.record(step)
    history.go_to(0)
    assert cloud.splat_count == 300 and cloud.sh_degree == own


def test_separate(make_cloud: Clouds) -> None:
    cloud = make_cloud(400, 1, 1)
    history = History(cloud)
    history.do(select(cloud, match_opacity(cloud, 0.6)))
    chosen, whole = cloud.selection().numpy(), cloud.to_cloud()
    taken, step = separate(cloud, "part")
    history.do(step)
    assert taken.name == "part"
    assert_rows(whole, chosen, taken)
    assert_rows(whole, ~chosen, cloud.to_cloud())
    with pytest.raises(StippleError, match="no splats are deleted"):
        restore(cloud)
    assert counts(cloud)["separated"] == chosen.sum() and counts(cloud)["deleted"] == 0
    history.undo()
    assert_rows(whole, slice(None), cloud.to_cloud())
    history.do(select_all(cloud))
    with pytest.raises(StippleError, match="every splat is selected"):
        separate(cloud)


def test_clone_stamp(make_cloud: Clouds) -> None:
    cloud = make_cloud(2000, 1, 1)
    history = History(cloud)
    history.do(select(cloud, match_opacity(cloud, 0.9)))
    before = every_byte(cloud)
    means = cloud.host("position").astype(np.float64)
    placed = scaling(2.0)
    offset = np.array([5.0, 1.0, 0.0])
    targets = [np.array([0.0, 0.0, 8.0]) + offset, np.array([1.0, 0.5, 8.0]) + offset]
    stroke = CloneStroke(cloud, translation(offset), placed)
    for target in targets:
        stroke.dab(target, 1.5)
    under = np.any([np.linalg.norm(2 * means - (t - offset), axis=1) <= 1.5 for t in targets], axis=0)
    assert 10 < under.sum() == cloud.splat_count - 2000
    history.record(stroke.finish())
    after = every_byte(cloud)
    np.testing.assert_allclose(cloud.host("position")[2000:], means[under] + offset / 2, atol=1e-5)
    history.undo()
    assert_same(cloud, before)
    history.redo()
    assert_same(cloud, after)
    history.undo()
    stroke = CloneStroke(cloud, translation(offset))
    stroke.dab(means[0] + offset, 0.5)
    stroke.cancel()
    assert_same(cloud, before)
    assert CloneStroke(cloud, translation(offset)).finish() is None
    assert_same(cloud, before)


def test_align_by_three_points() -> None:
    rng = np.random.default_rng(4)
    for scale in (True, False):
        wanted = composed(
            scaling(1.7 if scale else 1.0), composed(rotation(rng.normal(size=3), 2.2), translation((1, 2, 3)))
        )
        source = rng.normal(size=(3, 3))
        target = source @ wanted[:, :3].T + wanted[:, 3]
        np.testing.assert_allclose(align_points(source, target, scale), wanted, atol=1e-9)
    noisy = align_points(np.vstack([source, source + 1]), np.vstack([target, target + 1.1]))
    assert np.linalg.det(noisy[:, :3]) > 0
    mirrored = align_points(np.eye(3), np.diag([1.0, 1.0, -1.0]))
    assert np.linalg.det(mirrored[:, :3]) > 0
    np.testing.assert_allclose(composed(inverse(wanted), wanted), np.eye(3, 4), atol=1e-12)


def test_bad_calls_leave_everything(make_cloud: Clouds, monkeypatch: pytest.MonkeyPatch) -> None:
    cloud = make_cloud(300, 1, 1)
    history = History(cloud)
    for call, words in (
        (lambda: duplicate(cloud), "nothing is selected to duplicate"),
        (lambda: separate(cloud), "nothing is selected to separate"),
        (lambda: merge_clouds([]), "no captures"),
        (lambda: align_points(np.eye(3)[:2], np.eye(3)[:2]), "three or more"),
        (lambda: align_points([[0, 0, 0], [1, 1, 1], [2, 2, 2]], np.eye(3)), "on one line"),
        (lambda: align_points(np.ones((3, 3)), np.eye(3)), "source points are in one place"),
        (lambda: align_points(np.eye(3), 1e-20 * np.eye(3)), "target points are in one place"),
        (lambda: align_points(1e30 * np.eye(3), np.eye(3)), "scaled by"),
    ):
        with pytest.raises(StippleError, match=words):
            call()
    history.do(select_all(cloud))
    before = every_byte(cloud)
    for free in (0, 1000, 2000, 5000, 9000, 15_000):
        monkeypatch.setattr("stipple.engine.buffers.free_bytes", lambda device, free=free: free)
        for make in (lambda: duplicate(cloud, MOVE), lambda: append_cloud(cloud, random_cloud(300, 2, sh_degree=3))):
            with pytest.raises(StippleError, match="are needed"):
                history.do(make())
            assert_same(cloud, before)
    assert history.position == 1
