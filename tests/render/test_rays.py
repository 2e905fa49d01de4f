# SPDX-License-Identifier: GPL-3.0-or-later
"""*rays* on moderngl against the float64 oracle: places, shapes, cameras, filters, orders, and absurd input.

Measured on llvmpipe: 90 to 139 dB where 80 is asked; a pixel where ω falls on either side of p_min costs the most.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from stipple.engine.camera import Camera
from stipple.engine.renderer import Renderer
from stipple.engine.scene import Instance, Scene
from stipple.engine.settings import Settings
from tests.oracle.rays import render as oracle
from tests.scenes import cloud_of, front_camera, random_cloud, scene_of
from tests.stats.convergence import convergence_slope, find_plateau
from tests.stats.image_metrics import psnr
from tests.stats.z_test import tile_groups, z_test

FILTERS = [(0.0, False), (0.3, False), (0.1, True)]


def plain(**changes: Any) -> Settings:
    return Settings(method="rays", **({"dilation_px2": 0.0} | changes))


def agrees(rays: Renderer, scene: Scene, camera: Camera, **changes: Any) -> None:
    """The picture is the oracle's, and its depth where something is seen."""
    settings = plain(**changes)
    picture, wanted = rays.render(scene, camera, settings), oracle(scene, camera, **changes)
    assert wanted.rgba[..., 3].mean() > 0.05  # there is something to compare
    assert psnr(picture.rgba, wanted.rgba) > 80
    seen = wanted.rgba[..., 3] > 0.1
    np.testing.assert_allclose(picture.depth[seen], wanted.depth[seen], rtol=1e-2)


@pytest.mark.parametrize(("dilation_px2", "antialiased"), FILTERS)
@pytest.mark.parametrize("projection", ["pinhole", "orthographic"])
def test_pictures_are_the_oracles(rays: Renderer, projection: str, dilation_px2: float, antialiased: bool) -> None:
    focal = {} if projection == "pinhole" else {"fx": 12.0, "fy": 12.0}
    scene = scene_of(random_cloud(60, 1, sigma_px=(0.5, 8), sh_degree=3), background=(0.2, 0.4, 0.1))
    camera = front_camera(projection=projection, **focal)
    picture = rays.render(scene, camera, plain(dilation_px2=dilation_px2, antialiased=antialiased))
    wanted = oracle(scene, camera, dilation_px2=dilation_px2, antialiased=antialiased)
    assert psnr(picture.rgba, wanted.rgba) > 80


@pytest.mark.parametrize("exponent", [-6, -3, 0, 3, 6])
@pytest.mark.parametrize("dilation_px2", [0.0, 0.3])
def test_twelve_decades_of_needles_and_cameras_that_graze(rays: Renderer, exponent: int, dilation_px2: float) -> None:
    """Splats all around and behind the camera, axes up to 1 : 10⁴, some reaching past it, some around it."""
    rng, size = np.random.default_rng(exponent + 10), 10.0**exponent
    depth = rng.uniform(-0.5, 6, 150)
    position = np.column_stack([rng.uniform(-0.8, 0.8, (150, 2)) * np.abs(depth)[:, None], depth])
    scale = 10.0 ** rng.uniform(-4, 0.0, (150, 3)) * rng.uniform(0.3, 2, (150, 1))
    rotation, opacity = rng.normal(size=(150, 4)), rng.uniform(0.1, 1, 150)
    cloud = cloud_of(position * size, scale * size, opacity, rng.uniform(0, 1, (150, 3)), rotation)
    camera = front_camera(near=0.05 * size, far=1e3 * size)
    agrees(rays, scene_of(cloud), camera, dilation_px2=dilation_px2)


@pytest.mark.parametrize(("dilation_px2", "antialiased"), FILTERS)
def test_instances_may_be_sheared_and_mirrored(rays: Renderer, dilation_px2: float, antialiased: bool) -> None:
    """One cloud placed twice and another of a different SH degree, in one draw."""
    affine = np.array([[1, 0.7, 0, 0.1], [0, -0.3, 0.2, 0.2], [0.1, 0, 2, 0.5]])
    cloud, other = random_cloud(50, 3, sh_degree=3), random_cloud(20, 4, sh_degree=1)
    scene = Scene((Instance(cloud, affine), Instance(other), Instance(cloud)))
    agrees(rays, scene, front_camera(), dilation_px2=dilation_px2, antialiased=antialiased)


def test_a_flattened_object_is_drawn(rays: Renderer) -> None:
    affine = np.array([[1.0, 0, 0, 0], [0, 1.0, 0, 0], [0, 0, 0, 3.0]])
    scene = Scene((Instance(random_cloud(40, 8, sigma_px=(3, 9)), affine),))
    picture = rays.render(scene, front_camera(), plain())
    assert np.isfinite(picture.rgba).all()
    assert picture.rgba[..., 3].mean() > 0.1


@pytest.mark.parametrize("degree", range(5))
@pytest.mark.parametrize("sh_degree", [None, 1])
def test_colours_are_the_oracles(rays: Renderer, degree: int, sh_degree: int | None) -> None:
    scene = scene_of(random_cloud(60, 3, sh_degree=degree))
    agrees(rays, scene, front_camera(), sh_degree=sh_degree)


def test_supersampling_and_multisampling(rays: Renderer) -> None:
    scene = scene_of(random_cloud(60, 3, sigma_px=(0.5, 5)))
    agrees(rays, scene, front_camera(), supersampling=3)
    fine = oracle(scene, front_camera(), supersampling=8).rgba
    once = psnr(rays.render(scene, front_camera(), plain()).rgba, fine)
    four = psnr(rays.render(scene, front_camera(), plain(multisamples=4)).rgba, fine)
    assert four > once + 10


def test_a_window_is_cut_from_the_whole(rays: Renderer) -> None:
    """Not bit for bit as with the other methods: the hardware interpolates, and rounds elsewhere."""
    scene = scene_of(random_cloud(60, 3, sigma_px=(0.5, 5)))
    whole, part = (rays.render(scene, front_camera(window=w), plain()).rgba for w in (None, (13, 7, 20, 15)))
    np.testing.assert_allclose(part, whole[7:22, 13:33], atol=1e-5)


def small_scene() -> Scene:
    return scene_of(random_cloud(40, 21, sigma_px=(3, 14), sh_degree=1))


def accumulate(rays: Renderer, samples: int, seed: int, scene: Scene) -> np.ndarray:
    return rays.render(scene, front_camera(), plain(samples=samples, seed=seed, ray_order="stochastic")).rgba


def test_stochastic_has_the_mean_of_per_pixel_order(rays: Renderer) -> None:
    scene = small_scene()
    wanted = oracle(scene, front_camera(), order="pixel").rgba
    pictures = np.stack([accumulate(rays, 16, seed, scene) for seed in range(32)])
    groups = tile_groups(*wanted.shape[:2], 8, 16 * wanted[..., 3], 30.0)
    for outcome in (z_test(pictures, wanted), z_test(pictures, wanted, groups)):
        assert outcome.passes(), outcome.worst()
    # The test can tell: the order by means is another picture.
    assert not z_test(pictures, oracle(scene, front_camera()).rgba, groups).passes()


def test_stochastic_converges(rays: Renderer) -> None:
    scene = small_scene()
    wanted = oracle(scene, front_camera(), order="pixel").rgba
    counts = (1, 2, 4, 8, 16, 32, 64)
    runs = [[np.mean((accumulate(rays, n, 1000 * r + 7, scene) - wanted) ** 2) for n in counts] for r in range(6)]
    slope = convergence_slope(counts, runs)
    assert slope.value == pytest.approx(-1.0, abs=0.03)
    assert find_plateau(counts, runs).p_value > 1e-3


def test_stochastic_is_repeatable_and_moves_with_the_seed(rays: Renderer) -> None:
    first, again, other = (accumulate(rays, 2, seed, small_scene()) for seed in (5, 5, 6))
    assert (first == again).all()
    assert (first != other).any()


def test_an_order_is_found_and_uploaded_once_for_a_view(monkeypatch: pytest.MonkeyPatch, rays: Renderer) -> None:
    """And found again whenever the camera, an instance or a setting that culls has changed."""
    uploads: list[str] = []
    host = rays.raster().host
    upload = host.upload
    monkeypatch.setattr(host, "upload", lambda texture, texels: (uploads.append(texture.name), upload(texture, texels)))
    cloud, camera = random_cloud(30, 1), front_camera()
    moved = replace(camera, camera_from_world=camera.camera_from_world + [[0, 0, 0, 0.1]] * 3)
    turned = Instance(cloud, np.hstack([np.diag([1.0, -1.0, 1.0]), np.zeros((3, 1))]))

    def uploaded(scene: Scene, camera: Camera, **changes: Any) -> list[str]:
        uploads.clear()
        agrees(rays, scene, camera, **changes)
        return [name for name in uploads if name != "instances"]

    assert uploaded(scene_of(cloud), camera) == ["splats_0", "splats_1", "splats_2", "splats_3", "draw_order"]
    assert uploaded(scene_of(cloud), camera) == []
    assert uploaded(scene_of(cloud), camera, alpha_max=0.5) == []
    assert uploaded(scene_of(cloud), moved) == ["draw_order"]
    assert uploaded(Scene((turned,)), moved) == ["draw_order"]
    assert uploaded(Scene((turned,)), moved, dilation_px2=0.3) == ["draw_order"]


def test_a_scene_that_changes_is_uploaded_again(rays: Renderer) -> None:
    first, second = random_cloud(30, 1), random_cloud(45, 2)
    for scene in (scene_of(first), scene_of(second), scene_of(second, first), scene_of(first)):
        agrees(rays, scene, front_camera())
