# SPDX-License-Identifier: GPL-3.0-or-later
"""What *rays* leaves out changes no bit of a picture, and is most of what could be left out."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import warp as wp

from stipple.engine.camera import Camera
from stipple.engine.errors import StippleError
from stipple.engine.look import Look
from stipple.engine.rays import order
from stipple.engine.rays.order import MOST_PLACED, DrawOrder, find_order, first_places, order_key
from stipple.engine.rays.support import Frustum
from stipple.engine.renderer import Renderer
from stipple.engine.scene import Instance, Scene
from stipple.engine.settings import Settings
from stipple.engine.timing import StageTimer
from tests.oracle.rays import gather, opacities, pixel_rays
from tests.render.test_rays_captures import capture, inside
from tests.scenes import absurd_cloud, cloud_of, front_camera, random_cloud, scene_of

PLAIN = Settings(method="rays", dilation_px2=0.0)
FILTERED = Settings(method="rays", dilation_px2=0.3)
MIP = Settings(method="rays", dilation_px2=0.1, antialiased=True)
SUPER, MULTI = replace(MIP, supersampling=2), replace(MIP, multisamples=4)
STOCHASTIC = Settings(method="rays", dilation_px2=0.3, ray_order="stochastic", samples=2)


@pytest.fixture(autouse=True)
def nothing_given(rays: Renderer) -> Iterator[None]:
    yield
    rays.raster().given_order = None


def everything(_camera: Camera, _finest_px: float = 1.0) -> Frustum:
    """A window that no splat is beside, and pixels so fine that none is too faint."""
    frustum = Frustum()
    frustum.left = frustum.right = frustum.top = frustum.bottom = wp.vec4(0.0, 0.0, 0.0, 1e30)
    return frustum


def order_of(rays: Renderer, scene: Scene, camera: Camera, settings: Settings, finest_px: float = 1.0) -> DrawOrder:
    return find_order(rays.shot(scene, camera, settings, StageTimer(rays.device)), finest_px)


def uncut(rays: Renderer, scene: Scene, camera: Camera, settings: Settings) -> DrawOrder:
    """Of all that lies between near and far and is not below p_min before Eq. 17."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(order, "make_frustum", everything)
        return order_of(rays, scene, camera, settings)


def same(rays: Renderer, scene: Scene, camera: Camera, settings: Settings) -> float:
    """Asserts that culling changes no bit; the share of splats that it leaves."""
    orders = order_of(rays, scene, camera, settings), uncut(rays, scene, camera, settings)
    pictures = []
    for given in orders:
        rays.raster().given_order = given
        pictures.append(rays.render(scene, camera, settings))
    assert pictures[0].rgba.any()
    np.testing.assert_array_equal(pictures[0].rgba, pictures[1].rgba)
    np.testing.assert_array_equal(pictures[0].depth, pictures[1].depth)
    return orders[0].count / orders[1].count


def all_around(count: int, seed: int, **changes: Any) -> Scene:
    """Needles, discs and balls in front of the camera, around it and beside the frame, placed in every way."""
    rng = np.random.default_rng(seed)
    scale = 10.0 ** rng.uniform(-4, 0.0, (count, 3))
    cloud = cloud_of(
        rng.normal(size=(count, 3)) * [4, 4, 3] + [0, 0, 2],
        scale,
        rng.uniform(0, 1, count),
        rng.uniform(0, 1, (count, 3)),
        rng.normal(size=(count, 4)),
    )
    mirrored = np.hstack([np.diag([-1.0, 1.0, 1.0]), [[0.3], [0.1], [0.2]]])
    sheared = np.array([[1, 0.7, 0, 0.1], [0, -0.3, 0.2, 0.2], [0.1, 0, 2, 0.5]])
    look = Look(**changes)
    return Scene(tuple(Instance(cloud, place, look) for place in (np.eye(3, 4), mirrored, sheared)))


@pytest.mark.parametrize("settings", [PLAIN, FILTERED, MIP, STOCHASTIC, SUPER, MULTI])
@pytest.mark.parametrize("projection", ["pinhole", "orthographic"])
def test_culling_changes_no_bit(rays: Renderer, projection: str, settings: Settings) -> None:
    focal = 60.0 if projection == "pinhole" else 12.0
    for seed, window in ((1, None), (2, (40, 5, 12, 30))):
        camera = front_camera(projection=projection, fx=focal, fy=1.3 * focal, window=window, near=0.01)
        assert same(rays, all_around(1500, seed), camera, settings) < 0.6


@pytest.mark.parametrize("look", [{"display": "points"}, {"display": "ellipsoids"}, {"size": 3.0}, {"opacity": 0.2}])
def test_culling_changes_no_bit_of_other_looks(rays: Renderer, look: dict[str, Any]) -> None:
    assert same(rays, all_around(1500, 3, **look), front_camera(near=0.01), MIP) < 0.7


@pytest.mark.parametrize("exponent", [-6, 6])
def test_culling_changes_no_bit_at_any_scale(rays: Renderer, exponent: int) -> None:
    size = 10.0**exponent
    scene = all_around(1000, 4)
    placed = tuple(replace(i, world_from_object=size * np.asarray(i.world_from_object)) for i in scene.instances)
    assert same(rays, Scene(placed), front_camera(near=0.01 * size, far=1e3 * size), MIP) < 0.6


@pytest.mark.parametrize("projection", ["pinhole", "orthographic"])
def test_culling_changes_no_bit_of_nonsense(rays: Renderer, projection: str) -> None:
    focal = 60.0 if projection == "pinhole" else 12.0
    for settings in (PLAIN, MIP):
        same(rays, scene_of(absurd_cloud()), front_camera(projection=projection, far=3e38, fx=focal), settings)


@pytest.mark.real
@pytest.mark.parametrize("name", ["koala", "rubber_toy_cloud"])
def test_culling_changes_no_bit_of_captures(rays: Renderer, shared_data: Path, name: str) -> None:
    """Seen from outside, from the middle, in a window, and at 1/16 size with Eq. 17."""
    scene, cameras = capture(shared_data, name)
    middle = [inside(cameras[k], scene, 1.0) for k in (0, 3)]
    left = [same(rays, scene, camera, FILTERED) for camera in (cameras[0], *middle)]
    assert left[0] > 0.9 and max(left[1:]) < 0.45
    assert same(rays, scene, replace(cameras[5], window=(400, 200, 60, 60)), FILTERED) < 0.1
    flat = replace(middle[0], projection="orthographic", fx=300.0, fy=300.0, near=-50.0)
    assert same(rays, scene, flat, FILTERED) < 1.0
    small = cameras[0].resized(40, 30)
    assert same(rays, scene, small, replace(MIP, dilation_px2=0.05)) < 1.0


def test_little_is_drawn_that_no_ray_meets(rays: Renderer) -> None:
    """Of what is drawn, how much the oracle finds on no pixel: the margin, and quads between the pixels' centres."""
    camera = front_camera(near=0.01)
    scene = Scene(all_around(3000, 5).instances[:1])
    splats, lines = gather(scene, camera, dilation_px2=0.3), pixel_rays(camera, 1)
    met = sum(bool(opacities(splats, k, *lines, 1 / 255, 0.99)[0].any()) for k in range(len(splats.mean)))
    drawn = order_of(rays, scene, camera, FILTERED).count
    assert met > 50
    assert met <= drawn < 1.2 * met


def test_too_faint_after_modulation_is_left_out(rays: Renderer) -> None:
    """Eq. 17 takes these to a hundredth of their opacity: below p_min or, for the more opaque, not."""
    camera = front_camera()
    for opacity, drawn in ((0.35, 0), (0.45, 20)):
        sigma = np.sqrt(MIP.dilation_px2 / 99.0) * 3.0 / camera.fx  # balls: σ² / (σ² + filter) is 1/100
        cloud = cloud_of(np.tile([0.0, 0.0, 3.0], (20, 1)), sigma, opacity, 0.5)
        for linear in (np.eye(3), np.diag([2.0, 1.0, 1.0])):  # the last is tested without the shortcut
            scene = Scene((Instance(cloud, np.hstack([linear, np.zeros((3, 1))])),))
            wanted = 20 if linear[0, 0] == 2.0 else drawn
            assert order_of(rays, scene, camera, MIP).count == wanted
            assert order_of(rays, scene, camera, MIP, finest_px=0.25).count == 20
            assert order_of(rays, scene, camera, replace(MIP, antialiased=False)).count == 20


def test_an_order_serves_finer_pixels(rays: Renderer) -> None:
    """A viewport sorts once for pictures of different sizes: what a quarter of the size leaves out is not missed."""
    scene, fine = all_around(1500, 6), front_camera(256, 192, fx=240.0, fy=240.0, near=0.01)
    given = order_of(rays, scene, fine.resized(64, 48), MIP, finest_px=0.25)
    wanted = rays.render(scene, fine, MIP)
    rays.raster().given_order = given
    np.testing.assert_array_equal(rays.render(scene, fine, MIP).rgba, wanted.rgba)


def test_a_change_of_modulation_is_another_order(rays: Renderer) -> None:
    cloud = random_cloud(5, 1)
    on = replace(FILTERED, antialiased=True)
    keys = [
        order_key(rays.shot(Scene((Instance(cloud, look=look),)), front_camera(), settings, StageTimer(rays.device)))
        for settings, look in ((FILTERED, Look()), (on, Look(antialiased=False)), (on, Look()))
    ]
    assert keys[0] == keys[1] != keys[2]


def test_more_splats_than_can_be_sorted_are_refused() -> None:
    """Counted in 64 bits, whatever the instances; nothing is allocated."""
    assert first_places([]).tolist() == [0]
    assert first_places([MOST_PLACED - 5, 5]).tolist() == [0, MOST_PLACED - 5, MOST_PLACED]
    assert 2 * MOST_PLACED <= np.iinfo(np.int32).max < 2 * (MOST_PLACED + 1)
    for counts in ([MOST_PLACED, 1], [1 << 30], [3_000_000] * 1000):
        with pytest.raises(StippleError, match=rf"{sum(counts):,} splats together and 1,073,741,823 can be"):
            first_places(counts)
