# SPDX-License-Identifier: GPL-3.0-or-later
"""Looks of objects: the oracle's grading, crops, sizes and opacities in every method; points and ellipsoids."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from stipple.engine.camera import Camera
from stipple.engine.colour import linear_from_srgb
from stipple.engine.look import Crop, Look
from stipple.engine.renderer import Renderer
from stipple.engine.scene import Instance, Scene
from stipple.engine.settings import Settings
from tests.oracle.look import grade, kept
from tests.oracle.picture import render as oracle
from tests.oracle.projection import project
from tests.oracle.rays import render as rays_oracle
from tests.scenes import cloud_of, front_camera, random_cloud
from tests.stats.image_metrics import psnr
from tests.stats.z_test import tile_groups, z_test

SHEAR = np.array([[1, 0.7, 0, 0.1], [0, -0.3, 0.2, 0.2], [0.1, 0, 2, 0.5]])
MOVED = np.array([[0.8, -0.6, 0, 0.3], [0.6, 0.8, 0, -0.2], [0, 0, 1, 0.4]])
PAPER = (0.2, 0.4, 0.1)


def rows(size: float | tuple[float, float, float], centre: tuple[float, float, float], turn: float = 0.0) -> Any:
    c, s = np.cos(turn), np.sin(turn)
    linear = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]) @ np.diag(np.broadcast_to(size, 3))
    return tuple(map(tuple, np.column_stack([linear, centre]).tolist()))


BOX = Crop(rows((1.2, 0.7, 5.0), (0.3, 0.2, 3.0), 0.5))
BALL = Crop(rows((0.8, 1.0, 3.0), (-1.0, -0.4, 4.0)), "sphere")
HOLE = Crop(rows(1.6, (0.2, 0.1, 4.0)), "sphere", "outside")
GAP = Crop(rows((0.2, 9.0, 9.0), (0.4, 0.0, 0.0)), "box", "outside")

LOOKS = {
    "gain": Look(gain=(1.5, 0.8, 0.3)),
    "exposure": Look(exposure=-1.3),
    "brighter than white": Look(exposure=3.0),
    "saturated beyond the gamut": Look(saturation=2.5),
    "grey": Look(saturation=0.0),
    "tinted": Look(tint=(0.9, 0.2, 0.1), tint_factor=0.6),
    "tinted black": Look(tint=(0.0, 0.0, 0.0), tint_factor=0.5),
    "all colour at once": Look((1.2, 1.0, 0.6), 0.5, 1.4, (0.1, 0.3, 0.9), 0.3),
    "faint": Look(opacity=0.3),
    "dense": Look(opacity=5.0),
    "small": Look(size=0.4),
    "large": Look(size=1.7),
    "no size": Look(size=0.0),
    "base colour": Look(sh_degree=0),
    "antialiased": Look(antialiased=True),
    "box": Look(crops=(BOX,)),
    "sphere": Look(crops=(BALL,)),
    "either of two": Look(crops=(BOX, BALL)),
    "hollow": Look(crops=(HOLE, GAP)),
    "all crops at once": Look(crops=(BOX, HOLE, BALL, GAP)),
}


def scene_with(look: Look) -> Scene:
    """Two placements of one cloud and another cloud; the look is that of the first, the last has none."""
    cloud = random_cloud(70, 3, sh_degree=3)
    others = (Instance(cloud, MOVED, look=Look(exposure=0.5, crops=(HOLE,))), Instance(random_cloud(20, 4, sh_degree=1)))
    return Scene((Instance(cloud, SHEAR, look=look), *others), PAPER)


@pytest.mark.parametrize("look", LOOKS.values(), ids=LOOKS.keys())
def test_sorted_is_the_oracles(renderer: Renderer, look: Look) -> None:
    scene = scene_with(look)
    picture = renderer.render(scene, front_camera(), Settings(method="sorted"))
    assert psnr(picture.rgba, oracle(scene, front_camera()).rgba) > 75
    plain = oracle(scene_with(Look()), front_camera()).rgba
    assert psnr(picture.rgba, plain) < 50  # the look is one that shows


@pytest.mark.parametrize("look", LOOKS.values(), ids=LOOKS.keys())
def test_rays_are_the_oracles(rays: Renderer, look: Look) -> None:
    scene = scene_with(look)
    for dilation_px2, antialiased in ((0.3, False), (0.1, True)):
        settings = Settings(method="rays", dilation_px2=dilation_px2, antialiased=antialiased)
        picture = rays.render(scene, front_camera(), settings)
        wanted = rays_oracle(scene, front_camera(), dilation_px2=dilation_px2, antialiased=antialiased)
        assert psnr(picture.rgba, wanted.rgba) > 75


def test_points_have_the_mean_of_sorted(renderer: Renderer) -> None:
    look = Look((1.2, 1.0, 0.6), 0.5, 1.4, (0.1, 0.3, 0.9), 0.3, opacity=0.7, size=1.2, crops=(BOX, HOLE, BALL))
    scene = Scene((Instance(random_cloud(40, 21, sigma_px=(3, 14)), look=look),))
    wanted = oracle(scene, front_camera()).rgba
    pictures = np.stack(
        [renderer.render(scene, front_camera(), Settings(samples=16, seed=seed)).rgba for seed in range(32)]
    )
    groups = tile_groups(*wanted.shape[:2], 8, 16 * wanted[..., 3], 30.0)
    for outcome in (z_test(pictures, wanted), z_test(pictures, wanted, groups)):
        assert outcome.passes(), outcome.worst()
    almost = replace(scene, instances=(replace(scene.instances[0], look=replace(look, exposure=0.65)),))
    assert not z_test(pictures, oracle(almost, front_camera()).rgba, groups).passes()  # it can tell a seventh of a stop


@pytest.mark.parametrize("method", ["sorted", "points", "rays"])
def test_a_look_that_changes_nothing_changes_no_bit(rays: Renderer, method: str) -> None:
    """Every number spelled out, and crops that keep everything: the long way round gives the same bits."""
    everything = rows(1e6, (0, 0, 0))
    idle = Look(
        tint=(0.3, 0.1, 0.2), sh_degree=4, antialiased=False, point_px=9.0, least_opacity=0.9,
        crops=(Crop(everything), Crop(everything, "sphere"), Crop(rows(1.0, (0, 0, -90)), "box", "outside")),
    )  # fmt: skip
    settings = Settings(method=method, samples=4, device="cpu")
    cloud = random_cloud(200, 5, sh_degree=3)
    with_look, without = (
        rays.render(Scene((Instance(cloud, SHEAR, look=look), Instance(cloud, look=look)), PAPER), front_camera(), settings)
        for look in (idle, Look())
    )
    np.testing.assert_array_equal(with_look.rgba, without.rgba)
    np.testing.assert_array_equal(with_look.depth, without.depth)


@pytest.mark.parametrize("space", ["Rec.2020", "ACEScg"])
def test_grading_happens_in_the_working_space(renderer: Renderer, space: str) -> None:
    """A grey tint is grey in every space; a pure red gain leaves the working space's red, which no Rec.709 light is."""
    colour = (0.7, 0.5, 0.3)
    cloud = cloud_of([[0, 0, 2.0]], 1e3, 1.0, colour)

    def light(**look: Any) -> np.ndarray:
        look = Look(working_space=space, **look)
        settings = Settings(method="sorted", alpha_max=1.0)
        rgba = renderer.render(Scene((Instance(cloud, look=look),)), front_camera(), settings).rgba[24, 32]
        return linear_from_srgb(rgba[:3].astype(np.float64))

    flat = light()
    np.testing.assert_allclose(flat, linear_from_srgb(np.array(colour)), rtol=1e-4)
    np.testing.assert_allclose(light(exposure=1.0), 2 * flat, rtol=1e-3)
    grey = light(saturation=0.0)
    np.testing.assert_allclose(grey, grey[0], rtol=1e-3)
    # Rec.709 red, green and blue of Rec.2020 red (ITU-R BT.2407, table 2-1 inverted): green and blue fall below 0.
    red = light(gain=(1.0, 0.0, 0.0))
    assert red[0] > flat[0] and (red[1:] < 1e-4).all()


def test_what_artists_expect_of_light(renderer: Renderer) -> None:
    """One stop doubles the light of an opaque wall; a tint keeps its luminance."""
    wall = cloud_of([[0, 0, 2.0]], 1e3, 1.0, (0.5, 0.3, 0.4))

    def light(look: Look) -> np.ndarray:
        rgba = renderer.render(
            Scene((Instance(wall, look=look),)), front_camera(), Settings(method="sorted", alpha_max=1.0)
        ).rgba
        return linear_from_srgb(rgba[24, 32, :3].astype(np.float64))

    plain, weights = light(Look()), np.array([0.2126, 0.7152, 0.0722])
    np.testing.assert_allclose(light(Look(exposure=1.0)), 2 * plain, rtol=1e-4)
    np.testing.assert_allclose(light(Look(gain=(2.0, 1.0, 0.5))), plain * (2, 1, 0.5), rtol=1e-4)
    tinted = light(Look(tint=(0.1, 0.5, 0.9), tint_factor=1.0))
    assert tinted @ weights == pytest.approx(plain @ weights, rel=1e-3)
    np.testing.assert_allclose(tinted / tinted.sum(), np.array([0.1, 0.5, 0.9]) / 1.5, rtol=1e-3)


def test_exposing_splats_is_nearly_exposing_the_picture(renderer: Renderer) -> None:
    """Blending is linear in encoded values, where light's factor is nearly one too: a power law has no other."""
    cloud = random_cloud(400, 6, sh_degree=2)
    pictures = [
        renderer.render(Scene((Instance(cloud, look=look),)), front_camera(), Settings(method="sorted")).rgba
        for look in (Look(), Look(exposure=-1.0))
    ]
    plain, darker = (p[..., :3] / np.maximum(p[..., 3:], 1e-6) for p in pictures)
    covered = pictures[0][..., 3] > 0.5
    after = grade(plain[covered].astype(np.float64), Look(exposure=-1.0))
    assert np.abs(after - darker[covered]).max() < 0.02


# Culling


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


# Points and ellipsoids


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


def test_a_flattened_crop_holds_nothing(renderer: Renderer) -> None:
    flat = rows((1.0, 1.0, 0.0), (0, 0, 3))
    cloud = random_cloud(50, 2)
    for keep, seen in (("inside", False), ("outside", True)):
        scene = Scene((Instance(cloud, look=Look(crops=(Crop(flat, "box", keep),))),))
        assert (renderer.render(scene, front_camera(), Settings(method="sorted")).rgba.max() > 0) == seen


def test_crops_far_from_the_origin_keep_the_same_splats(renderer: Renderer) -> None:
    """Composed in float64: a million units away a crop is as sharp as at home."""
    away = np.array([1e6, -2e6, 3e6])
    cloud = random_cloud(500, 12)
    there = np.column_stack([np.eye(3), away])
    crop = Crop(rows((0.8, 0.5, 2.0), tuple(away + (0.1, 0.2, 4.0)), 0.3))  # type: ignore[arg-type]
    camera = front_camera(camera_from_world=np.column_stack([np.eye(3), -away]))
    picture = renderer.render(
        Scene((Instance(cloud, there, look=Look(crops=(crop,))),)), camera, Settings(method="sorted")
    )
    mask = kept(cloud.position.astype(np.float64), there, (crop,))
    assert 10 < mask.sum() < 490
    at_home = Crop(rows((0.8, 0.5, 2.0), (0.1, 0.2, 4.0), 0.3))
    wanted = oracle(Scene((Instance(cloud, look=Look(crops=(at_home,))),)), front_camera()).rgba
    assert psnr(picture.rgba, wanted) > 75
