# SPDX-License-Identifier: GPL-3.0-or-later
"""The oracle's pictures against closed forms and a loop over single pixels that shares none of its bounds."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from .picture import gather, render
from .plain_scene import PlainCamera, PlainInstance, PlainScene, cloud_of, random_cloud, scene_of
from .scene_like import Float64Array

CAMERA = PlainCamera()
AXIS = [[0.0125, 0.0125, 1.0]]  # projects to (16.5, 12.5): the centre of pixel column 16, row 12
DEEP_AXIS = [[0.025, 0.025, 2.0]]


def by_single_pixels(scene: PlainScene, camera: PlainCamera, alpha_min: float, alpha_max: float) -> Float64Array:
    """Premultiplied RGBA by the definition: every splat at every pixel, in Python floats."""
    splats = gather(scene, camera, 0.0, 0.3, False, None)
    order = sorted(range(len(splats.depth)), key=lambda k: (splats.depth[k], k))
    result = np.zeros((camera.height, camera.width, 4))
    for row in range(camera.height):
        for column in range(camera.width):
            left = 1.0
            for k in order:
                d = np.array([column + 0.5, row + 0.5]) - splats.mean_px[k]
                distance2 = float(d @ np.linalg.solve(splats.covariance_px2[k], d))
                alpha = min(alpha_max, float(splats.opacity[k]) * math.exp(-0.5 * distance2))
                if alpha >= alpha_min:
                    result[row, column] += left * alpha * np.array([*splats.colour[k], 1.0])
                    left *= 1.0 - alpha
    return result


@pytest.mark.parametrize("alpha_min", [0.0, 1 / 255, 0.2])
def test_agrees_with_the_definition_pixel_by_pixel(alpha_min: float) -> None:
    camera = replace(CAMERA, width=16, height=12, cx=8.0, cy=6.0, fx=20.0, fy=20.0)
    scene = scene_of(random_cloud(1, 12, degree=3), random_cloud(2, 12))
    picture = render(scene, camera, alpha_min=alpha_min, alpha_max=0.9)
    assert_allclose(picture.rgba, by_single_pixels(scene, camera, alpha_min, 0.9), atol=1e-13)
    assert picture.rgba[..., 3].max() > 0.9


def test_one_splat_in_closed_form() -> None:
    """A sphere on the optical axis: variance (f s / z)² + 0.3, nearly round; off the axis exactly as derived."""
    camera = replace(CAMERA, cx=16.5, cy=12.5)
    picture = render(scene_of(cloud_of([[0.0, 0.0, 2.0]], scale=0.1, opacity=0.8)), camera, alpha_max=0.999)
    variance = (40.0 * 0.1 / 2.0) ** 2 + 0.3
    x, y = np.meshgrid(np.arange(32) - 16.0, np.arange(24) - 12.0)
    alpha = 0.8 * np.exp(-(x**2 + y**2) / (2 * variance))
    alpha[alpha < 1 / 255] = 0.0
    assert_allclose(picture.rgba, alpha[..., None] * [1.0, 0.5, 0.25, 1.0], atol=1e-14)
    assert_array_equal(np.isinf(picture.depth), alpha == 0)
    assert_allclose(picture.depth[alpha > 0], 2.0, rtol=1e-14)


def test_total_coverage_is_the_gaussian_integral() -> None:
    """Σ alpha over pixels is 2π √|Σ| opacity when nothing is cut (the sum of a wide Gaussian is its integral)."""
    camera = PlainCamera(width=120, height=120, cx=60.0, cy=60.0)
    cloud = cloud_of([[0.1, -0.05, 2.0]], scale=(0.2, 0.1, 0.15), rotation=(0.8, 0.1, -0.3, 0.5), opacity=0.6)
    covariance = gather(scene_of(cloud), camera, 0.0, 0.3, False, None).covariance_px2[0]
    total = render(scene_of(cloud), camera, alpha_min=0.0).rgba[..., 3].sum()
    assert total == pytest.approx(0.6 * 2 * math.pi * math.sqrt(np.linalg.det(covariance)), rel=1e-9)


@pytest.mark.parametrize("red_first", [True, False])
@pytest.mark.parametrize("red_in_front", [True, False])
def test_two_splats_in_both_orders(red_first: bool, red_in_front: bool) -> None:
    near, far = AXIS, DEEP_AXIS
    red = cloud_of(near if red_in_front else far, opacity=0.75, rgb=(1, 0, 0))
    blue = cloud_of(far if red_in_front else near, opacity=0.5, rgb=(0, 0, 1))
    picture = render(scene_of(red, blue) if red_first else scene_of(blue, red), CAMERA)
    expected = [0.75, 0.0, 0.25 * 0.5, 0.875] if red_in_front else [0.5 * 0.75, 0.0, 0.5, 0.875]
    assert_allclose(picture.rgba[12, 16], expected, rtol=1e-13)
    front = 0.75 if red_in_front else 0.5
    assert picture.depth[12, 16] == pytest.approx((front * 1.0 + (0.875 - front) * 2.0) / 0.875)


def test_equal_depth_goes_by_instance_then_splat() -> None:
    """Two instances of one cloud of two coincident splats: the first splat of the first instance is in front."""
    cloud = cloud_of(AXIS * 2, opacity=0.5, rgb=[(1, 0, 0), (0, 1, 0)])
    other = cloud_of(AXIS, opacity=0.5, rgb=(0, 0, 1))
    assert_allclose(render(scene_of(cloud, other), CAMERA).rgba[12, 16], [0.5, 0.25, 0.125, 0.875])
    assert_allclose(render(scene_of(other, cloud), CAMERA).rgba[12, 16], [0.25, 0.125, 0.5, 0.875])


def test_a_hundred_splats_of_equal_depth_stay_in_order() -> None:
    """More than a sorting routine keeps in order by luck; the first is in front, and depth decides before order."""
    opacity, grey = 0.03, np.linspace(0.0, 1.0, 100)
    stack = cloud_of(AXIS * 100 + [[0.00625, 0.00625, 0.5]], opacity=opacity, rgb=np.append(grey, 0.5)[:, None])
    weight = opacity * (1 - opacity) ** np.arange(101)
    assert render(scene_of(stack), CAMERA).rgba[12, 16, 0] == pytest.approx(weight @ [0.5, *grey], rel=1e-12)


@pytest.mark.parametrize("alpha_max", [0.99, 0.999])
def test_opaque_splat_is_clamped(alpha_max: float) -> None:
    scene = scene_of(cloud_of(AXIS, opacity=1.0, rgb=(1, 1, 1)), background=(0.0, 0.5, 1.0))
    pixel = render(scene, CAMERA, alpha_max=alpha_max).rgba[12, 16]
    assert_allclose(pixel, [alpha_max, alpha_max + 0.5 * (1 - alpha_max), 1.0, 1.0], rtol=1e-14)


def test_background_and_nothing() -> None:
    empty = PlainScene((), (0.2, 0.4, 0.6))
    assert_array_equal(render(empty, CAMERA).rgba, np.broadcast_to([0.2, 0.4, 0.6, 1.0], (24, 32, 4)))
    behind = scene_of(cloud_of([[0.0, 0.0, -1.0]]))
    picture = render(behind, CAMERA)
    assert_array_equal(picture.rgba, np.zeros((24, 32, 4)))
    assert np.isposinf(picture.depth).all()


@pytest.mark.parametrize("supersampling", [1, 3])
def test_a_window_is_a_crop(supersampling: int) -> None:
    scene = scene_of(random_cloud(7, 60, degree=2), background=(0.1, 0.2, 0.3))
    whole = render(scene, CAMERA, supersampling=supersampling)
    part = render(scene, replace(CAMERA, window=(5, 7, 20, 9)), supersampling=supersampling)
    assert_allclose(part.rgba, whole.rgba[7:16, 5:25], atol=1e-14)
    assert_allclose(part.depth, whole.depth[7:16, 5:25], rtol=1e-13)


def test_supersampling_is_the_average_of_a_finer_camera() -> None:
    """s × s subpixels are the pixels of a camera s times as fine, dilated by 0.3 full pixels² = 0.3 s² fine ones."""
    scene, s = scene_of(random_cloud(8, 60, degree=1)), 4
    fine_camera = PlainCamera(width=32 * s, height=24 * s, fx=40.0 * s, fy=40.0 * s, cx=16.0 * s, cy=12.0 * s)
    fine = render(scene, fine_camera, dilation_px2=0.3 * s * s)
    coarse = render(scene, CAMERA, supersampling=s)
    assert_allclose(coarse.rgba, fine.rgba.reshape(24, s, 32, s, 4).mean(axis=(1, 3)), atol=1e-13)


def test_moving_the_world_with_the_camera_changes_nothing() -> None:
    cloud = random_cloud(9, 60, degree=4)
    turn = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    placed = PlainInstance(cloud, np.hstack([turn, [[3.0], [-2.0], [7.0]]]))
    followed = replace(CAMERA, camera_from_world=np.hstack([turn.T, -turn.T @ [[3.0], [-2.0], [7.0]]]))
    assert_allclose(render(PlainScene((placed,)), followed).rgba, render(scene_of(cloud), CAMERA).rgba, atol=1e-13)


def test_orthographic_splat_has_its_size_at_any_depth() -> None:
    camera = replace(CAMERA, projection="orthographic", fx=10.0, fy=10.0)
    pictures = [render(scene_of(cloud_of([[0.05, 0.05, z]], scale=0.2)), camera).rgba for z in (1.0, 50.0)]
    assert_allclose(pictures[0], pictures[1], atol=1e-14)
    assert pictures[0][12, 16, 3] == pytest.approx(0.8)
    assert pictures[0][12, 18, 3] == pytest.approx(0.8 * math.exp(-(2.0**2) / (2 * (4.0 + 0.3))))
