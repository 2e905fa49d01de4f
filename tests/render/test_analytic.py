# SPDX-License-Identifier: GPL-3.0-or-later
"""Scenes whose picture is known in closed form, by both methods."""

from __future__ import annotations

import numpy as np
import pytest

from stipple.engine.renderer import Renderer
from stipple.engine.scene import Instance, Scene
from stipple.engine.settings import Settings
from tests.oracle.picture import render as oracle
from tests.scenes import FOCAL_PX, FRAME, cloud_of, front_camera, random_cloud, scene_of

RED, GREEN = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)
CENTRE = (FRAME[1] // 2, FRAME[0] // 2)
SORTED = Settings(method="sorted")


TRIALS = 4096  # of `points()`: Bernoulli trials per pixel


def points(samples: int = TRIALS // 16, **changes: object) -> Settings:
    return Settings(method="points", samples=samples, **({"supersampling": 4} | changes))  # type: ignore[arg-type]


def five_sigma(alpha: float, samples: int) -> float:
    """What a mean of Bernoulli trials is allowed to be off, plus the float32 of the sums."""
    return 5.0 * np.sqrt(alpha * (1.0 - alpha) / samples) + 1e-5


def wide_splat(opacity: float, colour: tuple[float, float, float], depth: float = 4.0, sigma_px: float = 20.0):
    return cloud_of((0.0, 0.0, depth), sigma_px * depth / FOCAL_PX, opacity, colour)


@pytest.mark.parametrize("opacity", [0.005, 0.3, 0.9, 0.985, 1.0])
def test_one_splat_has_its_opacity(renderer: Renderer, opacity: float) -> None:
    camera, scene = front_camera(), scene_of(wide_splat(opacity, RED))
    y, x = np.mgrid[0 : FRAME[1], 0 : FRAME[0]]
    square = (x + 0.5 - FRAME[0] / 2) ** 2 + (y + 0.5 - FRAME[1] / 2) ** 2
    alpha = opacity * np.exp(-0.5 * square / (20.0**2 + 0.3))
    alpha = np.where(alpha < 1 / 255, 0.0, np.minimum(alpha, 0.99))
    picture = renderer.render(scene, camera, SORTED)
    edge = np.abs(opacity * np.exp(-0.5 * square / (20.0**2 + 0.3)) - 1 / 255) < 1e-5
    assert np.abs(picture.rgba[..., 3] - alpha)[~edge].max() < 2e-6
    assert np.abs(picture.rgba[..., 0] - picture.rgba[..., 3]).max() < 1e-6
    assert not picture.rgba[..., 1:3].any()
    stochastic = renderer.render(scene, camera, points())
    window = np.s_[CENTRE[0] - 3 : CENTRE[0] + 3, CENTRE[1] - 3 : CENTRE[1] + 3]
    mean, wanted = stochastic.rgba[window][..., 3].mean(), alpha[window].mean()
    # The mean over a pixel's area differs from its centre by at most alpha / (24 σ²) · 2.
    assert abs(mean - wanted) < five_sigma(wanted, TRIALS * 36) + wanted / (12 * 400)


def test_full_opacity_is_100_percent_and_not_63(renderer: Renderer) -> None:
    scene = scene_of(wide_splat(1.0, RED))
    picture = renderer.render(scene, front_camera(), points(64, alpha_max=1.0))
    assert picture.rgba[CENTRE][3] > 0.999
    clamped = renderer.render(scene, front_camera(), points(64))
    assert abs(clamped.rgba[CENTRE][3] - 0.99) < five_sigma(0.99, 64 * 16)


@pytest.mark.parametrize("first", ["red", "green"])
def test_two_splats_in_both_orders(renderer: Renderer, first: str) -> None:
    depths = (3.0, 5.0) if first == "red" else (5.0, 3.0)
    scene = scene_of(wide_splat(0.6, RED, depths[0]), wide_splat(0.5, GREEN, depths[1]))
    front, back = (0.6, (1 - 0.6) * 0.5) if first == "red" else ((1 - 0.5) * 0.6, 0.5)
    for settings, tolerance in ((SORTED, 1e-3), (points(), five_sigma(0.5, TRIALS) + 1e-3)):
        pixel = renderer.render(scene, front_camera(), settings).rgba[CENTRE]
        assert abs(pixel[0] - front) < tolerance and abs(pixel[1] - back) < tolerance
        assert abs(pixel[3] - 0.8) < tolerance


def test_coincident_splats_of_equal_depth_keep_their_order(renderer: Renderer) -> None:
    """The lower index is in front, in one cloud and across instances, and however far from a float's spacing z is."""
    for depth in (3.0, 3.1415927, 7.7):
        both = cloud_of([(0, 0, depth)] * 2, 20 * depth / FOCAL_PX, [0.6, 0.5], [RED, GREEN])
        apart = scene_of(wide_splat(0.6, RED, depth), wide_splat(0.5, GREEN, depth))
        for scene in (scene_of(both), apart):
            for settings, tolerance in ((SORTED, 1e-3), (points(64), five_sigma(0.5, 64 * 16) + 1e-3)):
                pixel = renderer.render(scene, front_camera(), settings).rgba[CENTRE]
                assert abs(pixel[0] - 0.6) < tolerance and abs(pixel[1] - 0.2) < tolerance


def test_a_thousand_faint_coincident_splats(renderer: Renderer) -> None:
    cloud = cloud_of([(0, 0, 4.0)] * 1000, 20 * 4 / FOCAL_PX, 0.008, RED)
    wanted = 1 - (1 - 0.008) ** 1000
    sorted_picture = renderer.render(scene_of(cloud), front_camera(), SORTED)
    assert abs(sorted_picture.rgba[CENTRE][3] - wanted) < 2e-3
    stochastic = renderer.render(scene_of(cloud), front_camera(), points(16))
    window = stochastic.rgba[CENTRE[0] - 2 : CENTRE[0] + 2, CENTRE[1] - 2 : CENTRE[1] + 2, 3]
    assert abs(window.mean() - wanted) < five_sigma(wanted, 256 * 16) + 2e-3


@pytest.mark.parametrize("method", ["points", "sorted"])
def test_zero_opacity_and_below_the_threshold_is_nothing(renderer: Renderer, method: str) -> None:
    settings = Settings(method=method, samples=64)
    for opacity in (0.0, 0.9 / 255):
        picture = renderer.render(scene_of(wide_splat(opacity, RED)), front_camera(), settings)
        assert not picture.rgba.any() and np.isinf(picture.depth).all()


@pytest.mark.parametrize("method", ["points", "sorted"])
@pytest.mark.parametrize("depth, seen", [(-3.0, False), (0.0, False), (0.19999, False), (0.2, False), (0.2001, True)])
def test_near_plane_cuts_by_the_mean(renderer: Renderer, method: str, depth: float, seen: bool) -> None:
    """Behind, on and crossing the near plane: as in 3DGS, a splat is there when its mean is."""
    cloud = cloud_of((0.0, 0.0, depth), 1.0, 0.9, RED)
    picture = renderer.render(scene_of(cloud), front_camera(), Settings(method=method, samples=4))
    assert np.isfinite(picture.rgba).all()
    assert bool(picture.rgba.any()) == seen


@pytest.mark.parametrize("method", ["points", "sorted"])
def test_beyond_far_is_nothing(renderer: Renderer, method: str) -> None:
    camera = front_camera(far=3.9)
    picture = renderer.render(scene_of(wide_splat(0.9, RED)), camera, Settings(method=method, samples=4))
    assert not picture.rgba.any()


@pytest.mark.parametrize("opacity", [0.2, 0.8, 1.0])
@pytest.mark.parametrize("sigma_px", [300.0, 1e5])
def test_splat_that_covers_the_whole_frame(renderer: Renderer, opacity: float, sigma_px: float) -> None:
    """Thrown at, it would need billions of points, and the paper's clamp would make it 63 % at most."""
    scene, camera = scene_of(wide_splat(opacity, RED, sigma_px=sigma_px)), front_camera()
    reference = renderer.render(scene, camera, SORTED).rgba
    assert reference[..., 3].min() > 0.9 * min(opacity, 0.99)
    picture = renderer.render(scene, camera, points(256, supersampling=1))
    assert picture.stats.points <= 256 * FRAME[0] * FRAME[1]  # at most one per subpixel
    mean, wanted = picture.rgba[..., 3].mean(), reference[..., 3].mean()
    assert abs(mean - wanted) < five_sigma(wanted, 256 * FRAME[0] * FRAME[1])


def test_sub_pixel_splats_keep_their_light(renderer: Renderer) -> None:
    """Splats far below a pixel are widened by the dilation; their total coverage is what Eq. 3 promises."""
    rng = np.random.default_rng(3)
    xy = rng.uniform(-0.4, 0.4, (200, 2)) * np.array(FRAME) * 4.0 / FOCAL_PX
    cloud = cloud_of(np.column_stack([xy, np.full(200, 4.0)]), 1e-4, 0.3, RED)
    camera, scene = front_camera(), scene_of(cloud)
    reference = oracle(scene, camera, supersampling=8).rgba[..., 3]
    picture = renderer.render(scene, camera, points(1024))
    assert abs(picture.rgba[..., 3].mean() / reference.mean() - 1) < 0.01


def test_antialiased_takes_opacity_for_dilation(renderer: Renderer) -> None:
    tiny = cloud_of((0.03, 0.02, 4.0), 0.2 * 4 / FOCAL_PX, 0.9, RED)
    camera, scene = front_camera(), scene_of(tiny)
    wanted = oracle(scene, camera, antialiased=True).rgba
    settings = Settings(method="sorted", antialiased=True)
    assert np.abs(renderer.render(scene, camera, settings).rgba - wanted).max() < 1e-5
    assert renderer.render(scene, camera, SORTED).rgba.sum() > 5 * wanted.sum()


def test_small_splats_are_left_out_on_request_only(renderer: Renderer) -> None:
    """The limit is on the larger radius of the support: 3.33 σ at full opacity."""
    cloud = cloud_of([(-0.8, 0, 4), (0.8, 0, 4)], [0.5 * 4 / FOCAL_PX, 3.0 * 4 / FOCAL_PX], 1.0, RED)
    whole, large = (
        renderer.render(scene_of(cloud), front_camera(), Settings(method="sorted", small_splat_px=limit)).rgba
        for limit in (0.0, 5.0)
    )
    left, right = np.s_[:, : FRAME[0] // 2 - 5], np.s_[:, FRAME[0] // 2 + 5 :]
    assert whole[left].any() and not large[left].any()
    assert np.array_equal(whole[right], large[right])


def test_nothing_in_view_is_the_background(renderer: Renderer) -> None:
    behind = scene_of(wide_splat(0.9, RED, depth=-4.0), background=(0.25, 0.5, 1.0))
    for scene in (behind, Scene((), (0.25, 0.5, 1.0))):
        for settings in (SORTED, points(2)):
            picture = renderer.render(scene, front_camera(), settings)
            assert np.allclose(picture.rgba, (0.25, 0.5, 1.0, 1.0))
            assert np.isinf(picture.depth).all()


def test_depth_is_the_mean_of_what_is_seen(renderer: Renderer) -> None:
    scene = scene_of(wide_splat(0.6, RED, 3.0), wide_splat(0.5, GREEN, 5.0))
    wanted = (0.6 * 3 + 0.2 * 5) / 0.8
    assert abs(renderer.render(scene, front_camera(), SORTED).depth[CENTRE] - wanted) < 1e-2
    assert (
        abs(renderer.render(scene, front_camera(), points()).depth[CENTRE] - wanted)
        < 5 * 0.87 / np.sqrt(TRIALS) / 0.8 + 0.01
    )


@pytest.mark.parametrize("sh_degree", range(5))
def test_random_scenes_equal_the_oracle(renderer: Renderer, sh_degree: int) -> None:
    cloud = random_cloud(300, 11 + sh_degree, sigma_px=(0.3, 25.0), sh_degree=sh_degree)
    camera = front_camera(cx=30.5, cy=27.25, fy=FOCAL_PX * 1.2)
    shear = np.array([[1.1, 0.2, 0.0, 0.1], [0.0, -0.8, 0.1, 0.0], [0.1, 0.0, 1.3, 0.2]])
    scene = Scene((Instance(cloud), Instance(cloud, shear)), (0.1, 0.2, 0.3))
    for settings, options in ((SORTED, {}), (Settings(method="sorted", supersampling=3), {"supersampling": 3})):
        wanted = oracle(scene, camera, **options)  # type: ignore[arg-type]
        picture = renderer.render(scene, camera, settings)
        # A pixel may fall on the other side of a splat's 1/255 edge in single precision, so a few errors of 1/255.
        error = np.abs(picture.rgba - wanted.rgba)
        assert np.sqrt((error**2).mean()) < 1e-4 and error.max() < 5e-3


def test_orthographic_equals_the_oracle(renderer: Renderer) -> None:
    cloud = random_cloud(300, 5, sh_degree=2)
    for near in (0.2, -10.0):
        camera = front_camera(projection="orthographic", fx=14.0, fy=13.0, near=near)
        wanted = oracle(scene_of(cloud), camera).rgba
        picture = renderer.render(scene_of(cloud), camera, SORTED)
        assert np.sqrt(((picture.rgba - wanted) ** 2).mean()) < 1e-4
        stochastic = renderer.render(scene_of(cloud), camera, points(64))
        assert np.sqrt(((stochastic.rgba - wanted) ** 2).mean()) < 0.02


@pytest.mark.parametrize("method", ["points", "sorted"])
def test_a_window_changes_no_pixel(renderer: Renderer, method: str) -> None:
    scene = scene_of(random_cloud(300, 8, sigma_px=(1.0, 300.0)))
    settings = Settings(method=method, samples=16, supersampling=2)
    whole = renderer.render(scene, front_camera(), settings).rgba
    part = renderer.render(scene, front_camera(window=(13, 7, 30, 21)), settings).rgba
    assert np.array_equal(part, whole[7:28, 13:43])


def test_needles_keep_their_width(renderer: Renderer) -> None:
    """1000 : 0.1 px needles across the frame: determinants by subtraction would lose all digits."""
    rng = np.random.default_rng(9)
    scale = np.array([1000.0, 0.1, 0.1]) * 4.0 / FOCAL_PX
    position = np.column_stack([rng.uniform(-1.5, 1.5, (40, 2)), rng.uniform(3, 5, 40)])
    cloud = cloud_of(position, scale, 0.8, rng.uniform(0, 1, (40, 3)), rng.normal(size=(40, 4)))
    wanted = oracle(scene_of(cloud), front_camera()).rgba
    picture = renderer.render(scene_of(cloud), front_camera(), SORTED)
    assert np.sqrt(((picture.rgba - wanted) ** 2).mean()) < 2e-3


@pytest.mark.parametrize("size", [1e12, 1e20, 1e38])
def test_overflowing_splats_look_the_same_to_both_methods(renderer: Renderer, size: float) -> None:
    scene = scene_of(cloud_of((0, 0, 4), size, 0.5, RED))
    sorted_picture = renderer.render(scene, front_camera(), SORTED).rgba
    assert np.abs(sorted_picture[..., 3] - 0.5).max() < 1e-3
    assert abs(renderer.render(scene, front_camera(), points(64)).rgba[..., 3].mean() - 0.5) < 0.01


@pytest.mark.parametrize("method", ["points", "sorted"])
def test_nothing_in_sight_is_said(renderer: Renderer, method: str) -> None:
    behind = renderer.render(scene_of(wide_splat(0.9, RED, depth=-4.0)), front_camera(), Settings(method=method))
    assert "None of the 1 splats can be seen" in behind.stats.warnings[0]
    assert not renderer.render(Scene(()), front_camera(), Settings(method=method)).stats.warnings


@pytest.mark.parametrize("method", ["points", "sorted"])
def test_absurd_splats_never_make_bad_pixels(renderer: Renderer, method: str) -> None:
    rng = np.random.default_rng(4)
    n = 400
    position = rng.normal(size=(n, 3)).astype(np.float32) * 10.0 ** rng.uniform(-20, 20, (n, 1))
    scale = 10.0 ** rng.uniform(-30, 30, (n, 3))
    cloud = cloud_of(position, scale, rng.uniform(0, 1, n), 1e6 * rng.normal(size=(n, 3)), rng.normal(size=(n, 4)))
    for values in (position, np.abs(position)):
        cloud.position[:] = values
        picture = renderer.render(scene_of(cloud), front_camera(), Settings(method=method, samples=2))
        assert np.isfinite(picture.rgba).all()
