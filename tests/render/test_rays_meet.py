# SPDX-License-Identifier: GPL-3.0-or-later
"""What a ray meets, in Warp, is what the pixel it goes through shows, drawn by GLSL."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from stipple.engine.camera import Camera
from stipple.engine.look import Look
from stipple.engine.picking import pick
from stipple.engine.rays.meet import meet_ray
from stipple.engine.renderer import Renderer
from stipple.engine.scene import Instance, Scene
from stipple.engine.settings import Settings
from stipple.engine.timing import StageTimer
from tests.render.test_rays_captures import capture, inside
from tests.scenes import absurd_cloud, cloud_of, front_camera, random_cloud, scene_of

FILTERED = Settings(method="rays", dilation_px2=0.3)
MIP = Settings(method="rays", dilation_px2=0.1, antialiased=True)


def met_at(rays: Renderer, scene: Scene, camera: Camera, settings: Settings, x: int, y: int) -> tuple[float, float]:
    """Alpha and mean depth of what the ray through a pixel's centre meets."""
    small = replace(camera, window=(x, y, 1, 1))
    shot = rays.shot(scene, small, settings, StageTimer(rays.device))
    _, _, opacity, depth = meet_ray(shot, x + 0.5, y + 0.5)
    weight = opacity * np.cumprod(np.concatenate([[1.0], 1.0 - opacity[:-1]]))
    return float(weight.sum()), float((weight * depth).sum() / max(weight.sum(), 1e-30))


def agrees(rays: Renderer, scene: Scene, camera: Camera, settings: Settings, step: int = 9) -> None:
    picture = rays.render(scene, camera, settings)
    width, height = camera.width, camera.height
    places = [(x, y) for y in range(2, height, height * step // 48) for x in range(2, width, width * step // 64)]
    alpha, depth = np.array([met_at(rays, scene, camera, settings, x, y) for x, y in places]).T
    x, y = np.array(places).T
    seen = picture.rgba[y, x, 3] > 0.02
    assert seen.sum() > 10
    difference = np.abs(alpha - picture.rgba[y, x, 3])
    assert np.quantile(difference, 0.9) < 1e-4 and difference.max() < 1 / 100  # where ω falls on either side of p_min
    np.testing.assert_allclose(depth[seen], picture.depth[y, x][seen], rtol=5e-3)


@pytest.mark.parametrize("changes", [{}, {"antialiased": True}, {"storage": "quantised"}, {"alpha_max": 0.5}])
@pytest.mark.parametrize("projection", ["pinhole", "orthographic"])
def test_a_ray_meets_what_its_pixel_shows(rays: Renderer, projection: str, changes: dict[str, Any]) -> None:
    """Two clouds, one of them placed again, sheared and mirrored."""
    affine = np.array([[1, 0.7, 0, 0.1], [0, -0.9, 0.2, 0.2], [0.1, 0, 1.5, 0.5]])
    cloud, other = random_cloud(300, 3, sh_degree=1), random_cloud(150, 4)
    focal = 60.0 if projection == "pinhole" else 14.0
    scene = Scene((Instance(cloud, affine), Instance(other), Instance(cloud, look=Look(size=1.5, opacity=0.7))))
    agrees(rays, scene, front_camera(projection=projection, fx=focal, fy=1.2 * focal), replace(FILTERED, **changes))


@pytest.mark.parametrize("display", ["points", "ellipsoids"])
def test_a_ray_meets_other_displays(rays: Renderer, display: str) -> None:
    scene = Scene((Instance(random_cloud(300, 5), look=Look(display=display, point_px=9.0)),))
    agrees(rays, scene, front_camera(), FILTERED)


@pytest.mark.parametrize("exponent", [-6, 6])
def test_a_ray_meets_the_same_at_any_scale(rays: Renderer, exponent: int) -> None:
    size = 10.0**exponent
    scene = Scene((Instance(random_cloud(300, 6), size * np.eye(3, 4)),))
    agrees(rays, scene, front_camera(near=0.1 * size, far=1e3 * size), MIP)


@pytest.mark.real
@pytest.mark.parametrize("storage", ["full", "quantised"])  # the latter in groups that lie together: most are left out
@pytest.mark.parametrize("projection", ["pinhole", "orthographic"])
def test_a_ray_meets_a_capture(rays: Renderer, shared_data: Path, projection: str, storage: str) -> None:
    scene, cameras = capture(shared_data, "rubber_toy_cloud")
    settings = replace(FILTERED, storage=storage)
    for camera in (cameras[0], inside(cameras[2], scene, 0.9)):
        focal = {} if projection == "pinhole" else {"fx": 200.0, "fy": 200.0, "near": -50.0}
        agrees(rays, scene, replace(camera, projection=projection, **focal), settings, step=5)


def test_nonsense_is_not_met(rays: Renderer) -> None:
    shot = rays.shot(scene_of(absurd_cloud()), front_camera(far=3e38), FILTERED, StageTimer(rays.device))
    splat, _, opacity, depth = meet_ray(shot, 32.5, 24.5)
    assert len(splat) > 0
    assert np.isfinite(depth).all() and (opacity > 0).all() and (opacity <= 1).all()
    nothing = rays.shot(Scene(()), front_camera(), FILTERED, StageTimer(rays.device))
    assert all(len(array) == 0 for array in meet_ray(nothing, 32.5, 24.5))


def test_stochastic_order_is_by_where_the_ray_meets(rays: Renderer) -> None:
    """A wall that leans back, its mean nearer than the ball's, but behind it on this ray; by means, before it."""
    half = np.pi / 8
    cloud = cloud_of(
        [[0.0, 0.0, 3.0], [0.8, 0.0, 3.2]],
        [[2.0, 2.0, 0.01], [0.1, 0.1, 0.1]],
        1.0,
        0.5,
        [[np.cos(half), 0.0, -np.sin(half), 0.0], [1.0, 0.0, 0.0, 0.0]],
    )
    camera = front_camera(window=(47, 24, 1, 1))
    found = {}
    for order in ("sorted", "stochastic"):
        settings = replace(FILTERED, ray_order=order)
        shot = rays.shot(scene_of(cloud), camera, settings, StageTimer(rays.device))
        splat, _, _, depth = meet_ray(shot, 47.5, 24.5)
        found[order] = splat.tolist()
        by_splat = dict(zip(splat.tolist(), depth.tolist(), strict=True))
    slope = (47.5 - 32.0) / 60.0
    assert by_splat[0] == pytest.approx(3.0 / (1.0 - slope), rel=1e-2)  # of the wall x = z − 3
    assert found == {"sorted": [0, 1], "stochastic": [1, 0]}


def test_a_pick_lies_on_the_splat_and_not_at_its_means_depth(rays: Renderer) -> None:
    cloud = cloud_of([[0.0, 0.0, 3.0]], [[2.0, 2.0, 0.01]], 1.0, 0.5, [[np.cos(np.pi / 8), 0, -np.sin(np.pi / 8), 0]])
    camera = front_camera()
    picture = rays.render(scene_of(cloud), camera, FILTERED)
    for x in (20, 40):
        seen = pick(rays, scene_of(cloud), camera, x, 24, FILTERED)
        assert seen is not None and seen.splat == 0
        slope = (x + 0.5 - camera.cx) / camera.fx
        assert seen.depth == pytest.approx(3.0 / (1.0 - slope), rel=1e-3)
        assert seen.depth == pytest.approx(float(picture.depth[24, x]), rel=1e-4)
        np.testing.assert_allclose(camera.project(seen.position_world)[0], (x + 0.5, 24.5, seen.depth), rtol=1e-6)
        flat = pick(rays, scene_of(cloud), camera, x, 24)
        assert flat is not None and flat.depth == pytest.approx(3.0)
