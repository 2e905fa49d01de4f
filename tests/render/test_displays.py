# SPDX-License-Identifier: GPL-3.0-or-later
"""Points and ellipsoids, and that no culling loses what a look makes larger."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from stipple.engine.camera import Camera
from stipple.engine.look import Look
from stipple.engine.points import method as points_method
from stipple.engine.renderer import Renderer
from stipple.engine.scene import Instance, Scene
from stipple.engine.settings import Settings
from tests.oracle.projection import project
from tests.scenes import cloud_of, front_camera, random_cloud
from tests.stats.image_metrics import psnr

from .test_looks import HOLE, PAPER, SHEAR


@pytest.mark.parametrize("method", ["sorted", "rays"])
@pytest.mark.parametrize("projection", ["pinhole", "orthographic"])
@pytest.mark.parametrize(
    "look", [Look(size=30.0), Look(display="points", point_px=40.0), Look(display="ellipsoids", size=30.0)]
)
def test_nothing_that_reaches_in_is_culled(rays: Renderer, method: str, projection: str, look: Look) -> None:
    """A window shows what the whole frame, many times as large, shows there."""
    rng, focal = np.random.default_rng(8), 60.0 if projection == "pinhole" else 12.0
    depth = rng.uniform(2, 6, 150)
    position = np.column_stack([rng.uniform(-1.5, 1.5, (150, 2)) * depth[:, None], depth])
    cloud = cloud_of(position, 0.01 * np.exp(rng.normal(size=(150, 3))), 0.9, rng.uniform(0, 1, (150, 3)))
    scene, settings = Scene((Instance(cloud, look=look),), PAPER), Settings(method=method)
    wide = front_camera(256, 192, projection=projection, fx=focal, fy=focal)
    part = rays.render(scene, replace(wide, window=(120, 90, 24, 16)), settings)
    whole = rays.render(scene, wide, settings)
    np.testing.assert_allclose(part.rgba, whole.rgba[90:106, 120:144], atol=1e-4)
    assert np.abs(part.rgba[..., :3] - PAPER).max() > 0.1


def one_splat(look: Look, method: str, renderer: Renderer, camera: Camera, **cloud: Any) -> np.ndarray:
    """Coverage of a red splat, with the colour checked to be its own."""
    values: dict[str, Any] = {"position": [[0.31, -0.22, 2.0]], "scale": 0.1, "opacity": 0.5, "colour": (1.0, 0.2, 0.1)}
    scene = Scene((Instance(cloud_of(**(values | cloud)), look=look),))
    return renderer.render(scene, camera, Settings(method=method, supersampling=4)).rgba


def subpixels(camera: Camera, supersampling: int = 4) -> tuple[np.ndarray, np.ndarray]:
    x = (np.arange(camera.width * supersampling) + 0.5) / supersampling
    y = (np.arange(camera.height * supersampling) + 0.5) / supersampling
    return np.meshgrid(x, y)


def boxed(subpixel: np.ndarray, supersampling: int = 4) -> np.ndarray:
    h, w = subpixel.shape
    return subpixel.reshape(h // supersampling, supersampling, w // supersampling, supersampling).mean(axis=(1, 3))


@pytest.mark.parametrize("method", ["sorted", "points", "rays"])
@pytest.mark.parametrize("projection", ["pinhole", "orthographic"])
@pytest.mark.parametrize("point_px", [3.0, 11.0])
def test_points_are_opaque_discs_of_their_size(rays: Renderer, method: str, projection: str, point_px: float) -> None:
    """Whatever size and opacity the splat has."""
    camera = front_camera(projection=projection)
    look = Look(display="points", point_px=point_px)
    rgba = one_splat(look, method, rays, camera)
    depth = 2.0 if projection == "pinhole" else 1.0
    centre = 32 + 60 * 0.31 / depth, 24 - 60 * 0.22 / depth
    x, y = subpixels(camera)
    wanted = boxed((np.hypot(x - centre[0], y - centre[1]) <= point_px / 2).astype(float))
    # A twentieth of the radius is soft; in rays a disc faces the eye and not the picture.
    assert np.abs(rgba[..., 3] - wanted).max() < (0.2 if method != "rays" else 0.3)
    assert rgba[..., 3].sum() == pytest.approx(wanted.sum(), rel=0.06)
    np.testing.assert_allclose(rgba[..., :3], rgba[..., 3:] * (1.0, 0.2, 0.1), atol=2e-3)
    if point_px > 10:
        assert rgba[..., 3].max() == 1.0  # opaque, and not alpha_max


@pytest.mark.parametrize("method", ["sorted", "points", "rays"])
def test_ellipsoids_end_at_one_and_a_half_deviations(rays: Renderer, method: str) -> None:
    camera = front_camera(fx=600.0, fy=600.0)  # so far away that the first order of the perspective is all of it
    scale, rotation = [0.6, 0.16, 0.3], [0.9, 0.1, -0.3, 0.4]
    cloud = cloud_of([[0.1, -0.05, 40.0]], [scale], 0.5, (1.0, 0.2, 0.1), rotation)
    scene = Scene((Instance(cloud, look=Look(display="ellipsoids")),))
    rgba = rays.render(scene, camera, Settings(method=method, supersampling=4)).rgba
    seen = project(Instance(cloud), camera, dilation_px2=0.0, antialiased=False, alpha_min=0.0)  # type: ignore[arg-type]
    x, y = subpixels(camera)
    offset = np.stack([x, y], axis=-1) - seen.mean_px[0]
    distance2 = np.einsum("...i,ij,...j", offset, np.linalg.inv(seen.covariance_px2[0]), offset)
    wanted = boxed((distance2 <= 1.5**2).astype(float))
    assert wanted.sum() > 60
    assert np.abs(rgba[..., 3] - wanted).max() < 0.25  # the rim
    assert rgba[..., 3].sum() == pytest.approx(wanted.sum(), rel=0.06)
    red = rgba[..., 0] / np.maximum(rgba[..., 3], 1e-6)
    inner, rim = boxed(distance2) < 0.2, (boxed(distance2) > 1.9) & (rgba[..., 3] > 0.9)
    assert red[inner].min() > 0.92 and red[rim].max() < 0.55
    shading = 1 - 0.65 * boxed(distance2) / 1.5**2
    solid = boxed(distance2) < 1.9
    np.testing.assert_allclose(red[solid], shading[solid], atol=0.04)


def dense_scene(look: Look) -> Scene:
    return Scene((Instance(random_cloud(300, 9, sigma_px=(1.0, 5.0), sh_degree=1), SHEAR, look=look),), PAPER)


@pytest.mark.parametrize("display", ["points", "ellipsoids"])
def test_points_and_sorted_display_the_same(renderer: Renderer, display: str) -> None:
    look = Look(display=display, point_px=5.0)
    exact = renderer.render(dense_scene(look), front_camera(), Settings(method="sorted", supersampling=2))
    thrown = renderer.render(dense_scene(look), front_camera(), Settings(samples=64, supersampling=2))
    difference = np.abs(exact.rgba - thrown.rgba)
    assert np.quantile(difference, 0.9) < 1e-4  # inside the rims, without any noise
    assert difference.mean() < 0.005


@pytest.mark.parametrize("display", ["points", "ellipsoids"])
def test_rays_and_sorted_display_the_same(rays: Renderer, display: str) -> None:
    look = Look(display=display, point_px=5.0)
    sorted_, drawn = (
        rays.render(dense_scene(look), front_camera(), Settings(method=method, supersampling=2)).rgba
        for method in ("sorted", "rays")
    )
    assert np.abs(sorted_ - drawn).mean() < 0.02


@pytest.mark.parametrize("method", ["sorted", "points", "rays"])
def test_faint_splats_are_not_displayed(rays: Renderer, method: str) -> None:
    opacity = np.array([0.05, 0.3, 0.6])
    cloud = cloud_of([[-0.8, 0, 3], [0, 0, 3], [0.8, 0, 3]], 0.05, opacity, (1, 1, 1))
    for look, seen in (
        (Look(display="points", point_px=5.0), [False, True, True]),
        (Look(display="points", point_px=5.0, least_opacity=0.5), [False, False, True]),
        (Look(display="points", point_px=5.0, least_opacity=0.5, opacity=0.9), [False, False, True]),
        (Look(display="ellipsoids", least_opacity=0.5, opacity=2.0), [False, True, True]),
    ):
        scene = Scene((Instance(cloud, look=look),))
        alpha = rays.render(scene, front_camera(), Settings(method=method)).rgba[..., 3]
        assert [bool(alpha[24, x] > 0.9) for x in (16, 32, 48)] == seen


def test_the_size_of_points_follows_the_pictures_pixels(renderer: Renderer) -> None:
    """A picture of half the size, shown twice as large, has discs of half the size."""
    camera, half = front_camera(), front_camera(32, 24, fx=30.0, fy=30.0)
    scene = Scene((Instance(cloud_of([[0, 0, 2.0]], 0.1, 1.0, (1, 1, 1)), look=Look(display="points", point_px=12.0)),))
    large = renderer.render(scene, camera, Settings(method="sorted", supersampling=4)).rgba
    small = renderer.render(scene, half, Settings(method="sorted", supersampling=4, point_scale=0.5)).rgba
    assert 4 * small[..., 3].sum() == pytest.approx(large[..., 3].sum(), rel=0.05)


@pytest.mark.parametrize("display", ["splats", "points", "ellipsoids"])
def test_records_and_splats_resolve_to_the_same_look(
    renderer: Renderer, display: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Large scenes find colours and shading of what was seen at the end, small ones at the beginning."""
    look = Look((1.2, 1.0, 0.6), 0.5, opacity=0.7, display=display, point_px=7.0, crops=(HOLE,))
    settings = Settings(samples=4, supersampling=2)
    small = renderer.render(dense_scene(look), front_camera(), settings)
    monkeypatch.setattr(points_method, "KEPT_SPLATS", 0)
    large = renderer.render(dense_scene(look), front_camera(), settings)
    np.testing.assert_allclose(large.rgba, small.rgba, atol=1e-5)
    np.testing.assert_allclose(large.depth, small.depth, rtol=1e-5)


def test_quantised_captures_have_looks(renderer: Renderer) -> None:
    look = Look((1.2, 1.0, 0.6), 0.5, size=1.3, opacity=0.7, crops=(HOLE,))
    full, quantised = (
        renderer.render(dense_scene(look), front_camera(), Settings(method="sorted", storage=storage)).rgba
        for storage in ("full", "quantised")
    )
    assert psnr(quantised, full) > 40
