# SPDX-License-Identifier: GPL-3.0-or-later
"""Temporal reprojection: it takes noise away while the camera moves, follows what it sees, and changes no still."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import warp as wp

from stipple.engine.buffers import Buffers
from stipple.engine.camera import Camera, look_at
from stipple.engine.device import choose_device
from stipple.engine.film import Picture
from stipple.engine.renderer import Renderer
from stipple.engine.reprojection import History, move_between
from stipple.engine.scene import Environment, EnvironmentImage, Scene
from stipple.engine.settings import Settings
from tests.scenes import front_camera, random_cloud, scene_of

LIVE = Settings(method="points", samples=1, reprojection=True)


def path(frames: int) -> list[Camera]:
    """Sideways and around, 1 to 2 px a frame."""
    camera = front_camera(160, 120, fx=150.0, fy=150.0)
    eyes = [(0.02 * k, 0.0, 0.01 * k) for k in range(frames)]
    return [replace(camera, camera_from_world=look_at(eye, (0, 0, 4))) for eye in eyes]


@pytest.fixture
def fresh(renderer: Renderer) -> Renderer:
    renderer.history.forget()
    return renderer


def scene() -> Scene:
    return scene_of(random_cloud(500, 1, sigma_px=(3.0, 8.0)), background=(0.2, 0.3, 0.4))


def error(picture: Picture, reference: Picture) -> float:
    return float(np.sqrt(np.mean((picture.rgba - reference.rgba) ** 2)))


def test_a_moving_camera_sees_less_noise(fresh: Renderer) -> None:
    """The error of single samples against *sorted* falls by a third and more; a mean of ten would take two thirds."""
    cameras = path(12)
    live = [fresh.render(scene(), camera, replace(LIVE, seed=k)) for k, camera in enumerate(cameras)]
    alone = fresh.render(scene(), cameras[-1], Settings(method="points", samples=1, seed=11))
    reference = fresh.render(scene(), cameras[-1], Settings(method="sorted"))
    assert error(live[-1], reference) < 0.67 * error(alone, reference)
    assert error(live[0], reference) > error(live[-1], reference)


def test_the_first_picture_and_every_other_one_stay_as_they_are(fresh: Renderer) -> None:
    cameras = path(3)
    plain = [fresh.render(scene(), camera, replace(LIVE, reprojection=False)).rgba for camera in cameras]
    live = [fresh.render(scene(), camera, LIVE).rgba for camera in cameras]
    assert np.array_equal(live[0], plain[0])
    assert not np.array_equal(live[1], plain[1])
    assert np.array_equal(fresh.render(scene(), cameras[2], replace(LIVE, reprojection=False)).rgba, plain[2])


def test_a_cut_to_something_else_leaves_no_ghost(fresh: Renderer) -> None:
    """Colours of the picture before are clamped to those around: a bright one does not shine through a dark one."""
    camera = path(1)[0]
    fresh.render(scene_of(random_cloud(500, 2), background=(1.0, 1.0, 1.0)), camera, LIVE)
    dark = fresh.render(scene_of(random_cloud(5, 3, opacity=(0.0, 1e-3)), background=(0.1, 0.1, 0.1)), camera, LIVE)
    np.testing.assert_allclose(dark.rgba[..., :3], 0.1, atol=1e-6)


def checkered() -> Environment:
    """Black and white squares of about 3 px as the moving camera sees them: nothing blurs more visibly."""
    down, around = np.mgrid[0:180, 0:360]
    squares = ((down + around) % 2)[..., None] * np.ones(3)
    ahead = ((0.0, 0.0, 1.0, 0.0), (-1.0, 0.0, 0.0, 0.0), (0.0, -1.0, 0.0, 0.0))  # the horizon, not the zenith
    return Environment(EnvironmentImage(np.ascontiguousarray(squares, np.float32)), ahead)


def turning(frames: int) -> list[Camera]:
    """On the spot, 1.3 px a frame: by no whole number of pixels, so that every look-up is between four."""
    camera = front_camera(160, 120, fx=150.0, fy=150.0)
    angles = 1.3 / 150.0 * np.arange(frames)
    return [replace(camera, camera_from_world=look_at((0, 0, 0), (np.sin(a), 0.0, np.cos(a)))) for a in angles]


def test_an_image_around_the_scene_stays_as_sharp_as_it_is(fresh: Renderer) -> None:
    """Where no splat is, a picture after twelve others holds the bits that it has alone."""
    cloud = random_cloud(20, 4, sigma_px=(1.0, 3.0))
    with_image, splats = scene_of(cloud, background=checkered()), scene_of(cloud)
    for k, camera in enumerate(turning(13)):
        live = fresh.render(with_image, camera, replace(LIVE, seed=k))
    alone = fresh.render(with_image, camera, replace(LIVE, seed=k, reprojection=False))
    covered = fresh.render(splats, camera, replace(LIVE, seed=k, reprojection=False)).rgba[..., 3] > 0
    near = np.pad(covered, 1)
    near = np.any([near[y : y + 120, x : x + 160] for y in range(3) for x in range(3)], axis=0)
    assert 0.1 < near.mean() < 0.9
    assert np.array_equal(live.rgba[~near], alone.rgba[~near])
    assert not np.array_equal(live.rgba, alone.rgba)


def test_splats_over_an_image_lose_their_noise(fresh: Renderer) -> None:
    """As before a plain colour, though the image behind them moves and they do not cover it wholly."""
    scene = scene_of(random_cloud(500, 1, sigma_px=(3.0, 8.0), opacity=(0.05, 0.4)), background=checkered())
    for k, camera in enumerate(turning(12)):
        live = fresh.render(scene, camera, replace(LIVE, seed=k))
    alone = fresh.render(scene, camera, replace(LIVE, seed=11, reprojection=False))
    reference = fresh.render(scene, camera, Settings(method="sorted"))
    assert error(live, reference) < 0.67 * error(alone, reference)


@pytest.mark.parametrize("projection", ["pinhole", "orthographic"])
def test_points_in_space_are_found_where_the_camera_before_saw_them(device: str, projection: str) -> None:
    """A ramp of colours fixed in the world comes out as the ramp again, whatever the move (float64 on the host)."""
    focal = 150.0 if projection == "pinhole" else 30.0
    cameras = [
        replace(front_camera(160, 120, fx=focal, fy=focal, projection=projection), camera_from_world=pose)
        for pose in (look_at((0, 0, 0), (0, 0, 4)), look_at((0.3, -0.2, 0.5), (0.1, 0.1, 4)))
    ]
    buffers = Buffers(choose_device(device))
    history, shown = History(), []
    for camera in cameras:
        y, x = np.mgrid[0:120, 0:160] + 0.5
        # Rays meet the plane z = 4 of the world; colour is linear in the place there.
        scale = np.ones_like(x) if projection == "pinhole" else np.zeros_like(x)
        local = np.stack([(x - 80) / focal, (y - 60) / focal, scale], axis=-1)
        rotation, shift = camera.camera_from_world[:, :3], camera.camera_from_world[:, 3]
        direction = local @ rotation if projection == "pinhole" else np.broadcast_to(rotation[2], local.shape)
        origin = camera.position if projection == "pinhole" else camera.position + local @ rotation
        distance = (4 - origin[..., 2]) / direction[..., 2]
        place = origin + distance[..., None] * direction
        depth = place @ rotation[2] + shift[2]
        rgba = np.dstack([0.5 + 0.05 * place[..., 0], 0.5 + 0.05 * place[..., 1], 0 * x, 0 * x + 1]).astype(np.float32)
        device_rgba = wp.array(rgba.reshape(-1, 4), dtype=wp.vec4, device=buffers.device)
        device_depth = wp.array(depth.ravel().astype(np.float32), dtype=wp.float32, device=buffers.device)
        history.mix(device_rgba, device_depth, camera, buffers)
        shown.append((rgba, device_rgba.numpy().reshape(120, 160, 4)))
    assert not np.array_equal(*shown[1])
    difference = np.abs(shown[1][1] - shown[1][0])
    assert difference.max() < 1e-3  # at the edge of the picture before, which is continued by half a pixel
    assert (difference < 2e-5).mean() > 0.99


def test_moves_compose_far_from_the_origin() -> None:
    target, offset = np.array([0.0, 0.0, 5.0]), np.full(3, 0.1)
    moves = []
    for eye in (np.zeros(3), np.array([1e6, 2e6, -3e6])):
        poses = (look_at(eye, eye + target), look_at(eye + offset, eye + target))
        moves.append(move_between(*(replace(front_camera(), camera_from_world=pose) for pose in poses)))
    np.testing.assert_allclose(np.array(moves[1].translation), np.array(moves[0].translation), atol=1e-4)
