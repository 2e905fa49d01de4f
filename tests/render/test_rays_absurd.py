# SPDX-License-Identifier: GPL-3.0-or-later
"""Corrupt and absurd input to *rays* on moderngl: no NaN, no driver error. Blender's host: tests/blender."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from stipple.engine.film import Picture
from stipple.engine.renderer import Renderer
from stipple.engine.scene import Scene
from stipple.engine.settings import Settings
from tests.scenes import absurd_cloud, cloud_of, front_camera, random_cloud, scene_of

FILTERS = [(0.0, False), (0.3, False), (0.1, True)]
ORDERS = ["sorted", "stochastic"]


def render(rays: Renderer, scene: Scene, camera: Any, **changes: Any) -> Picture:
    """A picture of finite numbers, drawn without an error of the driver."""
    picture = rays.render(scene, camera, Settings(**({"method": "rays", "samples": 4, "dilation_px2": 0.0} | changes)))
    assert np.isfinite(picture.rgba).all()
    assert not np.isnan(picture.depth).any()
    assert rays.raster().host._context.error == "GL_NO_ERROR"  # type: ignore[attr-defined]
    return picture


@pytest.mark.parametrize("projection", ["pinhole", "orthographic"])
@pytest.mark.parametrize("order", ORDERS)
@pytest.mark.parametrize(("dilation_px2", "antialiased"), FILTERS)
def test_absurd_input_makes_no_nan(
    rays: Renderer, projection: str, order: str, dilation_px2: float, antialiased: bool
) -> None:
    camera = front_camera(projection=projection, far=3e38, fx=12.0 if projection == "orthographic" else 60.0)
    changes = {"dilation_px2": dilation_px2, "antialiased": antialiased, "ray_order": order}
    picture = render(rays, scene_of(absurd_cloud()), camera, **changes)
    assert picture.rgba[..., 3].mean() > 0.1  # the honest ones are seen


@pytest.mark.parametrize("order", ORDERS)
@pytest.mark.parametrize(
    "spoilt", [{"scale": 0.0}, {"scale": 1e30}, {"opacity": np.nan}, {"scale": np.nan}, {"position": np.nan}]
)
def test_a_capture_of_nothing_but_nonsense(rays: Renderer, order: str, spoilt: dict[str, float]) -> None:
    """Every splat has it, so that nothing honest hides what it does."""
    honest = random_cloud(200, 9, sh_degree=1)
    cloud = replace(honest, **{name: np.full_like(getattr(honest, name), value) for name, value in spoilt.items()})
    picture = render(rays, scene_of(cloud), front_camera(), ray_order=order)
    assert (picture.rgba == 0).all()  # points without size, splats around the camera, and what has no number


@pytest.mark.parametrize("order", ORDERS)
def test_a_million_splats_behind_the_camera(rays: Renderer, order: str) -> None:
    behind = np.random.default_rng(1).normal(size=(1_000_000, 3)) - [0, 0, 10]
    picture = render(rays, scene_of(cloud_of(behind, 0.1, 0.5, 0.5)), front_camera(), ray_order=order)
    assert (picture.rgba == 0).all()
    assert picture.stats.splats_visible == 0


def test_nothing_to_draw(rays: Renderer) -> None:
    empty = render(rays, Scene((), (0.1, 0.2, 0.3)), front_camera())
    np.testing.assert_allclose(empty.rgba, np.broadcast_to([0.1, 0.2, 0.3, 1.0], empty.rgba.shape), rtol=1e-6)
