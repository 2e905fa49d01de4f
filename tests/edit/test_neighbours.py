# SPDX-License-Identifier: GPL-3.0-or-later
"""Neighbour searches against all pairs in float64, and the filters made of them."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from stipple.engine import device as engine_device
from stipple.engine.device import choose_device
from stipple.engine.edit.affine import scaling
from stipple.engine.edit.clean_up import find_faint, find_floaters, find_outside, find_oversized
from stipple.engine.edit.editable_cloud import EditableCloud
from stipple.engine.edit.flags import delete, hide
from stipple.engine.edit.history import History
from stipple.engine.edit.mask import mask_from_numpy
from stipple.engine.edit.match_values import match_colour, match_opacity
from stipple.engine.edit.match_visible import match_visible
from stipple.engine.edit.neighbours import grow, match_connected, match_near, match_sparse, shrink, typical_spacing
from stipple.engine.edit.selection import select
from stipple.engine.edit.state import LOCKED
from stipple.engine.errors import StippleError
from stipple.engine.renderer import Renderer
from stipple.engine.scene import Instance
from tests.edit.every_byte import assert_same, every_byte
from tests.scenes import cloud_of, front_camera

Clouds = Callable[..., EditableCloud]

STRETCH = np.array([[1.0, 0.4, 0.0, 7.0], [0.0, 1.5, 0.0, -3.0], [0.2, 0.0, 0.8, 0.0]])


def clumps(device: str, seed: int = 1) -> EditableCloud:
    """Dense clumps, a thin bridge between two of them, and dust: densities a thousandfold apart."""
    rng = np.random.default_rng(seed)
    centres = np.array([[0, 0, 5], [2.5, 0, 5], [0, 3, 6], [-4, -1, 5]])
    means = [
        centre + rng.normal(0, spread, (300, 3)) for centre, spread in zip(centres, (0.3, 0.3, 0.05, 0.8), strict=True)
    ]
    bridge = np.column_stack([np.linspace(0, 2.5, 30), np.zeros(30), np.full(30, 5.0)])
    dust = np.array([0, 0, 8]) + rng.uniform(-9, 9, (150, 3))
    means = np.vstack([*means, bridge, dust]).astype(np.float32)
    colours = np.where(np.arange(len(means))[:, None] % 2 == 0, [0.9, 0.1, 0.1], [0.1, 0.1, 0.9])
    return EditableCloud.from_cloud(cloud_of(means, 0.02, 0.8, colours), choose_device(device))


def distances(cloud: EditableCloud, matrix: np.ndarray | None = None) -> np.ndarray:
    means = cloud.host("position").astype(np.float64) @ (np.eye(3) if matrix is None else matrix[:, :3]).T
    return np.sqrt(np.square(means[:, None] - means[None]).sum(axis=2))


def flooded(adjacent: np.ndarray, seeds: np.ndarray) -> np.ndarray:
    reached, frontier = seeds.copy(), seeds
    while frontier.any():
        frontier = adjacent[frontier].any(axis=0) & ~reached
        reached |= frontier
    return reached


@pytest.mark.parametrize("matrix", [None, STRETCH])
@pytest.mark.parametrize("reach", [0.05, 0.3, 1.2, 40.0])
def test_near_sparse_and_connected(device: str, reach: float, matrix: np.ndarray | None) -> None:
    cloud = clumps(device)
    history = History(cloud)
    rng = np.random.default_rng(2)
    hidden = rng.random(cloud.splat_count) < 0.1
    history.do(select(cloud, mask_from_numpy(hidden, cloud.device)))
    history.do(hide(cloud))
    away, free = distances(cloud, matrix), ~hidden
    members = rng.random(cloud.splat_count) < 0.03
    found = match_near(cloud, mask_from_numpy(members, cloud.device), reach, matrix).numpy()
    np.testing.assert_array_equal(found, (away[:, members] <= reach).any(axis=1) & free)
    for neighbours in (1, 6):
        others = (away[:, free] <= reach).sum(axis=1) - 1
        sparse = match_sparse(cloud, reach, neighbours, matrix).numpy()
        np.testing.assert_array_equal(sparse, (others < neighbours) & free)
    seeds = np.arange(cloud.splat_count) == np.flatnonzero(free)[0]
    for within in (None, match_colour(cloud, (0.9, 0.1, 0.1), 0.05)):
        part = free if within is None else free & within.numpy()
        adjacent = (away <= reach) & part[None] & part[:, None]
        found = match_connected(cloud, mask_from_numpy(seeds, cloud.device), reach, matrix, within).numpy()
        np.testing.assert_array_equal(found, flooded(adjacent, seeds & part))


def test_a_flood_crosses_the_bridge_and_stops(device: str) -> None:
    cloud = clumps(device)
    seeds = mask_from_numpy(np.arange(cloud.splat_count) == 0, cloud.device)
    found = match_connected(cloud, seeds, 0.25).numpy()
    assert found[:600].mean() > 0.9 and found[600:900].mean() == 0 and found[1200:1230].all()
    cloud.state.numpy()[1205:1225] = 4  # deleted: the bridge is broken
    found = match_connected(cloud, seeds, 0.25).numpy()
    assert found[:300].mean() > 0.9 and found[300:600].mean() == 0


def test_grow_and_shrink(device: str) -> None:
    cloud = clumps(device)
    history = History(cloud)
    away = distances(cloud)
    chosen = np.arange(cloud.splat_count) < 150
    history.do(select(cloud, mask_from_numpy(chosen, cloud.device)))
    before = every_byte(cloud)
    history.do(grow(cloud, 0.2))
    grown = (away[:, chosen] <= 0.2).any(axis=1)
    np.testing.assert_array_equal(cloud.selection().numpy(), grown)
    history.do(shrink(cloud, 0.2))
    np.testing.assert_array_equal(cloud.selection().numpy(), grown & ~(away[:, ~grown] <= 0.2).any(axis=1))
    history.go_to(1)
    assert_same(cloud, before)


def test_typical_spacing(device: str) -> None:
    cloud = clumps(device)
    at = np.arange(64, dtype=np.int64) * cloud.splat_count // 64
    wanted = np.median(np.sort(distances(cloud)[at], axis=1)[:, 6])
    assert typical_spacing(cloud, 6) == pytest.approx(wanted, rel=1e-4)
    assert typical_spacing(cloud, 6, scaling(3.0)) == pytest.approx(3 * wanted, rel=1e-4)


def test_fewer_splats_than_neighbours_have_a_spacing_too(device: str) -> None:
    cloud = EditableCloud.from_cloud(
        cloud_of([[0, 0, 5], [3, 0, 5], [0, 4, 5]], 0.02, 0.8, (1, 1, 1)), choose_device(device)
    )
    assert typical_spacing(cloud, 6) == pytest.approx(np.median([4, 5, 5]), rel=1e-6)
    with pytest.raises(StippleError, match=r"none of the 3 splats that are shown can have 6 neighbors"):
        find_floaters(cloud)
    assert find_floaters(cloud, 0.9, 2).count() == 2  # within 4.5 the first has both others


def test_what_is_locked_keeps_others_company(device: str) -> None:
    cloud = clumps(device)
    spacing, found = typical_spacing(cloud), find_floaters(cloud).numpy()
    free = np.arange(cloud.splat_count) % 40 == 0
    cloud.state.assign(np.where(free, 0, LOCKED).astype(np.uint32))
    assert typical_spacing(cloud) == spacing
    np.testing.assert_array_equal(find_floaters(cloud).numpy(), found & free)
    assert (found & free).any() and (~found & free).any()


def test_clean_up_finds_what_is_wrong(device: str) -> None:
    cloud = clumps(device)
    scale, opacity = cloud.writable("scale").numpy(), cloud.writable("opacity").numpy()
    scale[10:20] = 1.0
    opacity[20:40] = 0.002
    floaters = find_floaters(cloud).numpy()
    assert floaters[-150:].mean() > 0.9 and floaters[:900].mean() < 0.03
    np.testing.assert_array_equal(np.flatnonzero(find_oversized(cloud, 0.5).numpy()), np.arange(10, 20))
    np.testing.assert_array_equal(np.flatnonzero(find_oversized(cloud, 1.5, scaling(2.0)).numpy()), np.arange(10, 20))
    np.testing.assert_array_equal(np.flatnonzero(find_faint(cloud).numpy()), np.arange(20, 40))
    crop = np.column_stack([np.diag([5.0, 5.0, 2.0]), [0, 0, 5]])
    means = cloud.host("position")
    inside = (np.abs(means - [0, 0, 5]) <= [5, 5, 2]).all(axis=1)
    outside = find_outside(cloud, crop)
    np.testing.assert_array_equal(outside.numpy(), ~inside)
    history = History(cloud)
    before = every_byte(cloud)
    history.do(delete(cloud, outside))
    assert cloud.to_cloud().splat_count == inside.sum() == cloud.splat_count - outside.count()
    history.undo()
    assert_same(cloud, before)


def test_threads_change_no_bit(device: str) -> None:
    cloud, before, results = clumps(device), engine_device.thread_count(), []
    seeds = mask_from_numpy(np.arange(cloud.splat_count) == 0, cloud.device)
    try:
        for threads in (1, 2, 7):
            engine_device.set_thread_count(threads)
            found = [match_connected(cloud, seeds, 0.3), match_sparse(cloud, 0.3), match_near(cloud, seeds, 1.0)]
            results.append([mask.words.numpy().tobytes() for mask in found])
    finally:
        engine_device.set_thread_count(before)
    assert results[0] == results[1] == results[2]


def test_visible_only(device: str) -> None:
    """A dense wall in front of a ball of splats, and a gap in the wall."""
    rng = np.random.default_rng(3)
    xy = np.stack(np.meshgrid(np.linspace(-2.5, 2.5, 70), np.linspace(-2.0, 2.0, 60)), axis=-1).reshape(-1, 2)
    xy = xy[np.abs(xy[:, 0]) > 0.4]
    wall = np.column_stack([xy, np.full(len(xy), 3.0)])
    ball = rng.normal(0, 0.4, (1500, 3)) * [1.5, 1, 0.2] + [0, 0, 6]
    cloud = EditableCloud.from_cloud(
        cloud_of(np.vstack([wall, ball]), 0.06, 0.99, (0.5, 0.5, 0.5)), choose_device(device)
    )
    renderer, camera = Renderer(device), front_camera(256, 192, fx=240.0, fy=240.0)
    found = match_visible(cloud, camera, renderer).numpy()
    px = camera.project(cloud.host("position"))
    inside = (px[:, 0] > 5) & (px[:, 1] > 5) & (px[:, 0] < 251) & (px[:, 1] < 187)
    is_wall = np.arange(cloud.splat_count) < len(wall)
    behind = ~is_wall & (np.abs(cloud.host("position")[:, 0]) > 1.3)  # hidden by the wall's halves, which end at ±0.8
    gap = ~is_wall & (np.abs(cloud.host("position")[:, 0]) < 0.5)
    assert found[is_wall & inside].mean() > 0.99
    assert behind.sum() > 20 and found[behind].mean() < 0.05
    assert found[gap].mean() > 0.3
    assert np.array_equal(found, match_visible(cloud, camera, renderer).numpy())
    cloud.state.numpy()[: len(wall)] = 2  # hide the wall: it no longer covers, nor is it seen
    found = match_visible(cloud, camera, renderer).numpy()
    assert found[behind].mean() > 0.5 and not found[is_wall].any()
    cover = Instance(cloud_of([[0, 0, 1]], 5.0, 0.99, (1, 1, 1)))
    assert match_visible(cloud, camera, renderer, others=[cover]).numpy().mean() < found.mean() / 2
    renderer.free()


def test_bad_calls_say_why(device: str) -> None:
    cloud = clumps(device)
    before = every_byte(cloud)
    nothing = match_opacity(cloud, 2, 3)
    stacked = EditableCloud.from_cloud(cloud_of([[0, 0, 5]] * 2, 0.02, 0.8, (1, 1, 1)), choose_device(device))
    alone = EditableCloud.from_cloud(cloud_of([[0, 0, 5]], 0.02, 0.8, (1, 1, 1)), choose_device(device))
    assert match_near(cloud, nothing, 1.0).count() == 0
    assert match_connected(cloud, nothing, 1.0).count() == 0
    for call, words in (
        (lambda: match_sparse(cloud, 0.0), "above 0"),
        (lambda: match_sparse(cloud, 1e-9), "too many cells"),
        (lambda: match_sparse(cloud, 1.0, 0), "at least 1"),
        (lambda: grow(cloud, 1.0), "nothing is selected to grow"),
        (lambda: shrink(cloud, 1.0), "nothing is selected to shrink"),
        (lambda: typical_spacing(cloud, 99), "99 neighbors; ask for 1 to 32"),
        (lambda: typical_spacing(alone), "fewer than two are shown"),
        (lambda: typical_spacing(stacked), "lie on each other"),
    ):
        with pytest.raises(StippleError, match=words):
            call()
    assert_same(cloud, before)
