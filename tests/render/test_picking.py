# SPDX-License-Identifier: GPL-3.0-or-later
"""Picking names the splat that most of a pixel's light comes past."""

from __future__ import annotations

import numpy as np
import pytest

from stipple.engine.errors import StippleError
from stipple.engine.picking import pick
from stipple.engine.renderer import Renderer
from stipple.engine.scene import Instance, Scene
from stipple.engine.settings import Settings
from tests.scenes import cloud_of, front_camera, random_cloud, scene_of


def shelf() -> Scene:
    """A faint splat before a solid one before another, in the middle of the frame; and one beside them."""
    position = [(0, 0, 2), (0, 0, 3), (0, 0, 4), (0.5, 0, 3)]
    return scene_of(cloud_of(position, 0.05, (0.3, 0.9, 0.9, 0.9), (0.5, 0.5, 0.5)))


def test_the_splat_that_hides_the_rest_is_picked(renderer: Renderer) -> None:
    camera = front_camera()
    seen = pick(renderer, shelf(), camera, 32, 24)
    assert seen is not None and (seen.instance, seen.splat) == (0, 1) and seen.depth == pytest.approx(3.0)
    beside = pick(renderer, shelf(), camera, 42, 24)
    assert beside is not None and beside.splat == 3
    np.testing.assert_allclose(camera.project(beside.position_world)[0], (42.5, 24.5, 3.0), atol=1e-5)


def test_where_little_is_seen_nothing_is_picked(renderer: Renderer) -> None:
    assert pick(renderer, shelf(), front_camera(), 5, 5) is None
    faint = scene_of(cloud_of([(0, 0, 2)], 0.05, 0.3, (0.5, 0.5, 0.5)))
    assert pick(renderer, faint, front_camera(), 32, 24) is None


def test_a_pixel_outside_is_refused(renderer: Renderer) -> None:
    with pytest.raises(StippleError, match="window"):
        pick(renderer, shelf(), front_camera(), 64, 0)


@pytest.mark.parametrize("storage", ["full", "quantised"])
def test_picks_are_where_the_picture_sees_something(renderer: Renderer, storage: str) -> None:
    """The picked depth lies among the depths that the mean depth of the pixel is a mean of."""
    beside = np.array([[1, 0, 0, 0.37], [0, 1, 0, 0], [0, 0, 1, 0]], float)
    cloud = random_cloud(3_000, 1, opacity=(0.3, 1.0))
    scene = Scene((Instance(cloud), Instance(cloud, beside)))
    settings = Settings(method="sorted", storage=storage)
    picture = renderer.render(scene, front_camera(), settings)
    picked = []
    for y in range(2, 48, 9):
        for x in range(2, 64, 9):
            seen = pick(renderer, scene, front_camera(), x, y, settings)
            assert (seen is not None) == (picture.rgba[y, x, 3] > 0.5)
            if seen is not None:
                picked.append((seen.depth, float(picture.depth[y, x]), seen.instance))
    depth, mean, instance = np.array(picked).T
    assert len(depth) > 30 and np.corrcoef(depth, mean)[0, 1] > 0.7
    assert set(instance) == {0, 1}
