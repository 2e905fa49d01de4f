# SPDX-License-Identifier: GPL-3.0-or-later
"""Captures that cut into each other, in stochastic *rays*: a clean line, the right depth, the oracle's picture."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from stipple.engine.camera import Camera
from stipple.engine.formats import read_splats
from stipple.engine.formats.cameras_file import read_cameras
from stipple.engine.renderer import Renderer
from stipple.engine.scene import Instance, Scene
from stipple.engine.settings import Settings
from stipple.engine.splats import SplatCloud
from tests import walls
from tests.oracle.rays import render as oracle
from tests.scenes import front_camera, scene_of
from tests.stats.z_test import tile_groups, z_test

SORTED = Settings(method="rays", dilation_px2=0.0)
STOCHASTIC = replace(SORTED, ray_order="stochastic", samples=64)


def crossing_walls() -> Scene:
    return scene_of(walls.wall(0, (1.0, 0.0, 0.0)), walls.wall(1, (0.0, 1.0, 0.0)))


def view() -> Camera:
    return front_camera(walls.WIDTH, walls.HEIGHT, fx=walls.FOCAL_PX, fy=walls.FOCAL_PX)


def misplaced(rgba: np.ndarray) -> float:
    """[px]; see `walls.misplaced`."""
    return float(walls.misplaced(rgba[..., 0] > rgba[..., 1]).max())


def test_crossing_walls_meet_in_a_clean_line(rays: Renderer) -> None:
    """Each pixel shows the wall that its ray meets first; not one pixel is undecided."""
    rgba, depths = rays.render(crossing_walls(), view(), STOCHASTIC).rgba, walls.depths()
    assert 0.2 < (depths[0] < depths[1]).mean() < 0.8
    assert rgba[..., 3].min() > 0.95
    assert misplaced(rgba) < 1.0
    assert undecided(rgba) == 0
    # No order of means can: splats of the farther wall come out in front, and the line is a gradient.
    by_means = rays.render(crossing_walls(), view(), SORTED).rgba
    assert misplaced(by_means) > 3.0
    assert undecided(by_means) > 6


def undecided(rgba: np.ndarray) -> int:
    """Most pixels of a row that show a tenth of either wall at least."""
    return int((rgba[..., :2].min(axis=-1) > 0.1).sum(axis=1).max())


def test_its_depth_is_that_of_the_wall_seen(rays: Renderer) -> None:
    """What a compositor needs to put a mesh between: z of the nearer wall, also beside the line where they cross."""
    picture = rays.render(crossing_walls(), view(), STOCHASTIC)
    nearer = walls.depths().min(axis=0)
    error = np.abs(picture.depth - nearer) / nearer
    # 1 % of the samples look through the nearer wall (opacity ends at 0.99) and see the other, up to 3 units on.
    assert np.median(error) < 1e-3 and np.quantile(error, 0.99) < 0.03 and error.max() < 0.1
    mean_order = oracle(crossing_walls(), view(), order="pixel")
    np.testing.assert_allclose(picture.depth.mean(), mean_order.depth.mean(), rtol=2e-3)


@pytest.mark.real
@pytest.mark.slow
def test_real_captures_that_cut_into_each_other_have_the_oracles_mean(rays: Renderer, shared_data: Path) -> None:
    """The toy pushed into the koala, where both show; every pixel in the order of its own depths."""
    koala, toy = (read_splats(shared_data / "real" / f"{name}.ply").cloud for name in ("koala", "rubber_toy_cloud"))
    camera = read_cameras(shared_data / "real" / "koala_cameras.json")[0]
    scene = Scene((Instance(koala), Instance(toy, onto(toy, koala))))
    patch = replace(camera, window=PATCH)
    wanted = oracle(scene, patch, order="pixel").rgba
    pictures = np.stack([rays.render(scene, patch, replace(STOCHASTIC, samples=16, seed=s)).rgba for s in range(16)])
    np.testing.assert_allclose(pictures[..., 3].mean(axis=0), wanted[..., 3], atol=0.05)
    groups, colours = tile_groups(*wanted.shape[:2], 4), slice(0, 3)
    outcome = z_test(pictures[..., colours], wanted[..., colours], groups)
    assert outcome.passes(), outcome.worst()
    by_means = oracle(scene, patch).rgba
    assert not z_test(pictures[..., colours], by_means[..., colours], groups).passes()


PATCH = (304, 228, 32, 24)


def onto(cloud: SplatCloud, other: SplatCloud) -> np.ndarray:
    """world_from_object that puts the middle of a cloud on the middle of another, at half its size."""
    sizes = [
        np.linalg.norm(np.quantile(c.position, 0.9, axis=0) - np.quantile(c.position, 0.1, axis=0))
        for c in (cloud, other)
    ]
    scale = 0.5 * sizes[1] / sizes[0]
    middle, target = (np.median(c.position, axis=0) for c in (cloud, other))
    return np.column_stack([scale * np.eye(3), target - scale * middle])
