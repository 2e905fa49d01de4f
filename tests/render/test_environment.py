# SPDX-License-Identifier: GPL-3.0-or-later
"""An equirectangular image behind the splats, against a float64 oracle, for every method."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from stipple.engine.camera import Camera, look_at
from stipple.engine.colour import scene_linear_from_display
from stipple.engine.errors import StippleError
from stipple.engine.renderer import Frame, Renderer
from stipple.engine.scene import Environment, EnvironmentImage, Scene
from stipple.engine.settings import Settings
from tests.oracle.environment import display_from_light, light_behind
from tests.scenes import random_cloud, scene_of

METHODS = ("points", "sorted", "rays")
SIZE = (70, 50)


def noise(seed: int = 3, shape: tuple[int, int] = (16, 32), brightest: float = 1e4) -> EnvironmentImage:
    """Independent pixels over seven decades, some slightly negative as out of the gamut."""
    rng = np.random.default_rng(seed)
    pixels = brightest * 10.0 ** rng.uniform(-7, 0, (*shape, 3))
    return EnvironmentImage(np.where(rng.random(pixels.shape) < 0.1, -0.01, pixels).astype(np.float32))


def turned(angles: tuple[float, float, float]) -> np.ndarray:
    a, b, c = angles
    turn_z = np.array([[np.cos(a), -np.sin(a), 0], [np.sin(a), np.cos(a), 0], [0, 0, 1]])
    turn_y = np.array([[np.cos(b), 0, np.sin(b)], [0, 1, 0], [-np.sin(b), 0, np.cos(b)]])
    turn_x = np.array([[1, 0, 0], [0, np.cos(c), -np.sin(c)], [0, np.sin(c), np.cos(c)]])
    return turn_z @ turn_y @ turn_x


def around(image: EnvironmentImage, linear: np.ndarray | None = None, shift: float = 0.0, strength: float = 1.0):
    affine = np.hstack([np.eye(3) if linear is None else linear, np.full((3, 1), shift)])
    return Environment(image, tuple(tuple(map(float, row)) for row in affine), strength)


def camera_at(target: tuple[float, float, float], **changes: object) -> Camera:
    """At the origin, looking at `target` with +z up."""
    up = (0.0, 0.0, 1.0) if abs(target[2]) < 0.9 else (1.0, 0.0, 0.0)
    camera = Camera(look_at((0, 0, 0), target, up), *SIZE, 40.0, 44.0, 33.0, 28.0)
    return replace(camera, **changes)  # type: ignore[arg-type]


def light(picture) -> np.ndarray:  # type: ignore[no-untyped-def]
    return scene_linear_from_display(picture.rgba)[..., :3]


def empty(environment: Environment) -> Scene:
    return Scene((), environment)


@pytest.fixture(params=METHODS)
def method(request: pytest.FixtureRequest) -> str:
    return str(request.param)


@pytest.fixture
def of_method(request: pytest.FixtureRequest, renderer: Renderer, method: str) -> Renderer:
    """The renderer for the method of the test."""
    return request.getfixturevalue("rays") if method == "rays" else renderer


@pytest.mark.parametrize("target", [(1, 0, 0), (-1, 0.01, 0), (0.3, -0.8, 0.5), (0, 0, 1), (0, 0, -1)])
@pytest.mark.parametrize("supersampling", [1, 3])
def test_directions_and_light_are_the_oracles(renderer: Renderer, target: tuple, supersampling: int) -> None:
    """Seams, poles, a shifted principal point, a turned and squashed environment, a window, a sheared camera."""
    image = noise()
    environment = around(image, turned((0.7, -0.4, 2.0)) @ np.diag([1.0, 0.6, 2.0]), 0.2, 1.7)
    sheared = camera_at(target).camera_from_world @ np.array(
        [[1, 0.2, 0, 0], [0, 1, 0.1, 0], [0, 0, 1, 0], [0, 0, 0, 1]]
    )
    for camera in (camera_at(target), camera_at(target, camera_from_world=sheared, window=(11, 5, 40, 31))):
        picture = renderer.render(empty(environment), camera, Settings(method="sorted", supersampling=supersampling))
        wanted = light_behind(image.pixels, environment.environment_from_world, 1.7, camera, supersampling)
        # A ray's place is off by float32's rounding of an angle, which tells between neighbours a factor 10⁷ apart.
        assert np.abs(light(picture) - wanted).max() < 2e-5 * 1e4
        assert np.median(np.abs(light(picture) / wanted - 1)) < 1e-5
        assert (picture.rgba[..., 3] == 1).all() and np.isinf(picture.depth).all()


def test_where_things_are(renderer: Renderer) -> None:
    """The image's centre at +x, its right quarter at −y, its first row above."""
    pixels = np.zeros((64, 128, 3), np.float32)
    pixels[:, 60:68, 0] = 1
    pixels[:, 92:100, 1] = 1
    pixels[:6, :, 2] = 1
    environment = around(EnvironmentImage(pixels))
    for target, channel in (((1, 0, 0), 0), ((0, -1, 0), 1), ((0, 0, 1), 2)):
        seen = light(renderer.render(empty(environment), camera_at(target), Settings(method="sorted")))[28, 33]
        assert np.argmax(seen) == channel and seen[channel] > 0.999, target
    turned_camera = look_at((0, 0, 0), (1, 0, 0), (0, 0, 1))
    wide = Camera(turned_camera, 90, 90, 5, 5, 45, 45)
    picture = light(renderer.render(empty(environment), wide, Settings(method="sorted")))
    assert picture[45, :45, 1].max() < 0.01 < picture[45, 45:, 1].max()  # −y is to the right of +x
    assert picture[:20, 45, 2].max() > 0.99 and picture[45:, :, 2].max() == 0


def test_an_orthographic_camera_sees_one_direction(renderer: Renderer) -> None:
    image = noise()
    camera = camera_at((0.2, -0.5, 0.4), projection="orthographic", near=-10.0)
    seen = light(renderer.render(empty(around(image)), camera, Settings(method="sorted")))
    assert (seen == seen[0, 0]).all()
    np.testing.assert_allclose(seen, light_behind(image.pixels, np.eye(3, 4), 1.0, camera), rtol=2e-5)


@pytest.mark.parametrize("value", [0.0, 1e-6, 0.0031308, 0.18, 1.0, 16.0, 65504.0, 1e30, -0.02])
def test_uncovered_pixels_are_the_images_light(of_method: Renderer, method: str, value: float) -> None:
    """To the rounding of float32, whatever lies in front elsewhere; and nothing is NaN."""
    environment = around(EnvironmentImage(np.full((4, 8, 3), value, np.float32)))
    scene = replace(scene_of(random_cloud(40, 1, sigma_px=(1.0, 4.0), opacity=(0.6, 1.0))), background=environment)
    camera = Camera(np.eye(3, 4), 96, 72, 80.0, 80.0, 48.0, 36.0)
    picture = of_method.render(scene, camera, Settings(method=method, samples=4))
    uncovered = of_method.render(replace(scene, background=None), camera, Settings(method=method, samples=4)).rgba[
        ..., 3
    ]
    seen = light(picture)
    assert np.isfinite(picture.rgba).all() and np.isfinite(seen).all()
    assert (uncovered == 0).mean() > 0.05 and uncovered.max() > 0.5
    np.testing.assert_allclose(seen[uncovered == 0], value, rtol=2e-6)


def test_splats_blend_over_it_in_display_space(of_method: Renderer, method: str) -> None:
    image = noise(brightest=20.0)
    scene, camera = scene_of(random_cloud(80, 1)), Camera(np.eye(3, 4), 96, 72, 80.0, 80.0, 48.0, 36.0)
    settings = Settings(method=method, samples=8)
    film = of_method.render(scene, camera, settings)
    over = of_method.render(replace(scene, background=around(image)), camera, settings)
    behind = display_from_light(light_behind(image.pixels, np.eye(3, 4), 1.0, camera))
    wanted = film.rgba[..., :3] + (1 - film.rgba[..., 3:]) * behind
    assert np.abs(over.rgba[..., :3] - wanted).max() < 1e-4
    assert (over.rgba[..., 3] == 1).all()
    assert np.array_equal(over.depth, film.depth)


def test_a_window_changes_no_bit(of_method: Renderer, method: str) -> None:
    camera = Camera(np.eye(3, 4), 96, 72, 80.0, 80.0, 48.0, 36.0)
    scene, settings = Scene((), around(noise(), turned((1, 2, 3)))), Settings(method=method, samples=2, supersampling=2)
    whole = of_method.render(scene, camera, settings).rgba
    x, y, width, height = window = (17, 9, 50, 33)
    part = of_method.render(scene, replace(camera, window=window), settings).rgba
    assert np.array_equal(part, whole[y : y + height, x : x + width])


def test_an_image_is_uploaded_once_and_leaves_with_its_scene(renderer: Renderer) -> None:
    image = noise()
    renderer.render(empty(around(image)), camera_at((1, 0, 0)), Settings(method="sorted"))
    held = renderer.environment(image)
    renderer.render(empty(around(image, strength=2.0)), camera_at((0, 1, 0)), Settings(method="sorted"))
    assert renderer.environment(image) is held
    renderer.render(Scene(()), camera_at((1, 0, 0)), Settings(method="sorted"))
    assert renderer.environment(image) is not held


def test_samples_do_not_look_again(renderer: Renderer) -> None:
    frame = Frame(renderer, empty(around(noise())), camera_at((1, 0, 0)), Settings(method="points", samples=3))
    frame.render_sample(0)
    first = frame.resolve()
    frame.render_sample(1)
    assert frame.resolve().stats.stage_seconds["background"] == first.stats.stage_seconds["background"]


@pytest.mark.parametrize(
    ("pixels", "sentence"),
    [
        (np.zeros((4, 8), np.float32), "give \\(height, width, 3\\) pixels"),
        (np.zeros((4, 8, 3)), "give contiguous float32"),
        (np.full((4, 8, 3), np.nan, np.float32), "not finite"),
    ],
)
def test_unusable_images_are_refused(pixels: np.ndarray, sentence: str) -> None:
    with pytest.raises(StippleError, match=sentence):
        EnvironmentImage(pixels)
