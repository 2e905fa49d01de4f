# SPDX-License-Identifier: GPL-3.0-or-later
"""Looks of objects: the oracle's grading, crops, sizes and opacities in every method; points and ellipsoids."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from stipple.engine.colour import linear_from_srgb
from stipple.engine.look import Crop, Look
from stipple.engine.renderer import Renderer
from stipple.engine.scene import Instance, Scene
from stipple.engine.settings import Settings
from tests.oracle.look import grade, kept
from tests.oracle.picture import render as oracle
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
    others = (
        Instance(cloud, MOVED, look=Look(exposure=0.5, crops=(HOLE,))),
        Instance(random_cloud(20, 4, sh_degree=1)),
    )
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
        rays.render(
            Scene((Instance(cloud, SHEAR, look=look), Instance(cloud, look=look)), PAPER), front_camera(), settings
        )
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
    crop = Crop(rows((0.8, 0.5, 2.0), tuple(away + np.array([0.1, 0.2, 4.0])), 0.3))  # type: ignore[arg-type]
    camera = front_camera(camera_from_world=np.column_stack([np.eye(3), -away]))
    picture = renderer.render(
        Scene((Instance(cloud, there, look=Look(crops=(crop,))),)), camera, Settings(method="sorted")
    )
    mask = kept(cloud.position.astype(np.float64), there, (crop,))
    assert 10 < mask.sum() < 490
    at_home = Crop(rows((0.8, 0.5, 2.0), (0.1, 0.2, 4.0), 0.3))
    wanted = oracle(Scene((Instance(cloud, look=Look(crops=(at_home,))),)), front_camera()).rgba
    assert psnr(picture.rgba, wanted) > 75
