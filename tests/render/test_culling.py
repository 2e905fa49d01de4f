# SPDX-License-Identifier: GPL-3.0-or-later
"""Culling never changes a bit of a picture, and it does leave out what is hidden.

Scenes here are small, so slabs are made small, too: without that they would be staged whole and nothing be culled.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt
import pytest

from stipple.engine.camera import Camera, look_at
from stipple.engine.look import Crop, Look
from stipple.engine.points import method
from stipple.engine.renderer import Renderer
from stipple.engine.scene import Instance, Scene
from stipple.engine.settings import CULLING, Settings
from stipple.engine.splats import SplatCloud
from tests.scenes import cloud_of, front_camera, random_cloud, scene_of


@pytest.fixture
def slabs(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Stage even the smallest scene slab by slab."""
    monkeypatch.setattr(method, "KEPT_SPLATS", 0)
    monkeypatch.setattr(method, "SMALLEST_SLAB", 1024)
    yield


def wall(z: float, count: int, seed: int, half: float = 1.8, opacity: float = 0.95) -> SplatCloud:
    """A wall across the front camera's view, so dense that nothing shines through."""
    rng = np.random.default_rng(seed)
    position = np.column_stack([rng.uniform(-half, half, (count, 2)), rng.uniform(z, z + 0.05, count)])
    return cloud_of(position, 0.06, opacity, rng.uniform(0, 1, (count, 3)))


def stacked_walls() -> Scene:
    return scene_of(*(wall(2.0 + step, 6_000, step) for step in range(4)))


def thin_foreground() -> Scene:
    """A picket fence of needles before a wall: what is behind shows between them."""
    x = np.repeat(np.linspace(-2, 2, 30), 40)
    y = np.tile(np.linspace(-2, 2, 40), 30)
    scale = np.tile([0.004, 0.06, 0.004], (len(x), 1))
    fence = cloud_of(np.column_stack([x, y, np.full(len(x), 1.5)]), scale, 0.99, (0.1, 0.5, 0.9))
    return scene_of(fence, wall(3.0, 6_000, 1), wall(4.0, 6_000, 2))


def sheared_instances() -> Scene:
    cloud = random_cloud(4_000, 3, sigma_px=(0.5, 6.0), sh_degree=2)
    shear = np.array([[1.0, 0.3, 0.0, 0.4], [0.0, -0.8, 0.2, 0.1], [0.1, 0.0, 1.3, 1.0]])
    return Scene((Instance(cloud), Instance(wall(1.8, 5_000, 4, half=0.7)), Instance(cloud, shear)))


def boundless() -> Scene:
    """Splats larger than anything, among small ones."""
    return scene_of(
        cloud_of([(0, 0, 50), (3, 0, 60), (1e6, 0, 900)], (40.0, 1e30, 1e6), 0.4, (0.2, 0.4, 0.1)),
        random_cloud(3_000, 5),
        wall(2.5, 3_000, 6),
    )


def looked() -> Scene:
    """Walls that looks make larger, fainter, cropped, points and ellipsoids: bounds of groups must follow."""
    ball = Crop(((0.9, 0, 0, 0.2), (0, 0.9, 0, 0), (0, 0, 9.0, 0)), "sphere", "outside")
    looks = (
        Look(size=6.0, opacity=0.5, crops=(ball,)),
        Look(display="ellipsoids", size=2.0, crops=(ball,)),
        Look(display="points", point_px=14.0, exposure=1.0),
        Look(gain=(0.2, 1.0, 1.5), opacity=3.0),
    )
    walls = [wall(2.0 + step, 6_000, step, opacity=0.3 + 0.2 * step) for step in range(4)]
    return Scene(tuple(Instance(cloud, look=look) for cloud, look in zip(walls, looks, strict=True)))


SCENES: dict[str, Callable[[], Scene]] = {
    "walls": stacked_walls,
    "fence": thin_foreground,
    "instances": sheared_instances,
    "boundless": boundless,
    "looked": looked,
}


def pinhole(eye: Sequence[float], target: Sequence[float], **changes: object) -> Camera:
    return replace(front_camera(160, 120, fx=150.0, fy=150.0), camera_from_world=look_at(eye, target), **changes)


def path_with_cuts() -> list[Camera]:
    """Forward, sideways, a cut to behind the walls, close to one, an orthographic view, a window, another size."""
    steps = [pinhole((0.05 * k, 0.02 * k, -0.4 + 0.1 * k), (0.0, 0.0, 4.0)) for k in range(4)]
    behind = pinhole((0.5, 0.5, 9.0), (0.0, 0.0, 2.0))
    close = pinhole((0.0, 0.0, 1.7), (0.3, 0.1, 4.0), near=0.05)
    ortho = front_camera(160, 120, fx=40.0, fy=40.0, near=-1.0, far=30.0, projection="orthographic")
    window = pinhole((0.3, 0.0, 0.0), (0.0, 0.0, 4.0), window=(37, 20, 90, 71))
    return [*steps, behind, steps[2], close, ortho, window, front_camera(64, 48)]


def pictures(renderer: Renderer, scene: Scene, settings: Settings) -> list[npt.NDArray[np.float64]]:
    """Colour, coverage and depth of every frame of the path, one after the other on one renderer."""
    rendered = [renderer.render(scene, camera, settings) for camera in path_with_cuts()]
    return [np.dstack([picture.rgba, picture.depth]) for picture in rendered]


def assert_same_bits(pictures: list[npt.NDArray], others: list[npt.NDArray]) -> None:
    assert len(pictures) == len(others)
    for frame, (picture, other) in enumerate(zip(pictures, others, strict=True)):
        assert np.array_equal(picture, other), f"frame {frame} differs in {(picture != other).any(axis=2).sum()} pixels"


@pytest.mark.parametrize("name", SCENES)
@pytest.mark.parametrize("storage", ["full", "quantised"])
@pytest.mark.usefixtures("slabs")
def test_culling_changes_no_bit_of_points(renderer: Renderer, name: str, storage: str) -> None:
    scene = SCENES[name]()
    settings = Settings(method="points", samples=3, storage=storage)
    wanted = pictures(renderer, scene, replace(settings, culling="none"))
    assert max(float(picture[..., 3].mean()) for picture in wanted) > 0.5
    for culling in ("frustum", "occlusion"):
        assert_same_bits(pictures(renderer, scene, replace(settings, culling=culling)), wanted)


@pytest.mark.parametrize("name", SCENES)
def test_slabs_change_no_bit(renderer: Renderer, name: str, request: pytest.FixtureRequest) -> None:
    """Records that are kept and colours that are found at the end give the same picture."""
    scene, settings = SCENES[name](), Settings(method="points", samples=2, supersampling=2)
    kept = pictures(renderer, scene, settings)
    request.getfixturevalue("slabs")
    assert_same_bits(pictures(renderer, scene, settings), kept)


@pytest.mark.parametrize("name", SCENES)
def test_culling_changes_no_bit_of_sorted(renderer: Renderer, name: str) -> None:
    scene = SCENES[name]()
    wanted = pictures(renderer, scene, Settings(method="sorted", culling="none"))
    assert_same_bits(pictures(renderer, scene, Settings(method="sorted")), wanted)


@pytest.mark.usefixtures("slabs")
def test_what_walls_hide_is_left_out(renderer: Renderer) -> None:
    scene, camera = stacked_walls(), pinhole((0.0, 0.0, 0.0), (0.0, 0.0, 4.0))
    visible = {
        culling: renderer.render(scene, camera, Settings(samples=2, culling=culling)).stats.splats_visible
        for culling in CULLING
    }
    assert visible["none"] == visible["frustum"]
    assert visible["occlusion"] < 0.3 * visible["frustum"]


@pytest.mark.usefixtures("slabs")
def test_the_foreground_hides_at_once_and_the_frame_before_helps(renderer: Renderer) -> None:
    """The pyramid is remembered from frame to frame, and forgotten with the device's memory."""
    scene, camera = stacked_walls(), pinhole((0.0, 0.0, 0.0), (0.0, 0.0, 4.0))
    everything = renderer.render(scene, camera, Settings(samples=1, culling="frustum")).stats.splats_visible
    renderer.free()
    first, second = (renderer.render(scene, camera, Settings(samples=1)).stats.splats_visible for _ in range(2))
    assert second < first < 0.3 * everything
    renderer.free()
    assert renderer.render(scene, camera, Settings(samples=1)).stats.splats_visible == first


def test_groups_outside_the_frustum_are_not_staged(renderer: Renderer) -> None:
    """Of a long row of splats the camera sees a piece; working memory is that of the piece."""
    x = np.linspace(-500, 500, 50_000)
    scene = scene_of(cloud_of(np.column_stack([x, 0 * x, 0 * x + 3]), 0.01, 0.9, (0.5, 0.5, 0.5)))
    peaks = {}
    for culling in ("none", "frustum"):
        renderer.free()
        renderer.buffers.peak_bytes = 0
        peaks[culling] = renderer.render(scene, front_camera(), Settings(samples=1, culling=culling)).stats.peak_bytes
    assert peaks["none"] - peaks["frustum"] > 4 * 0.9 * len(x)
