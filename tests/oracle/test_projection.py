# SPDX-License-Identifier: GPL-3.0-or-later
"""Projection against finite differences of the camera, sampled splats, and the rules of INRIA's rasteriser."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from .plain_scene import PlainCamera, PlainCloud, PlainInstance, cloud_of, random_cloud
from .projection import ProjectedSplats, project, rotation_matrices, view_directions
from .scene_like import Float64Array

SHEAR_AND_MIRROR = np.array([[1.3, 0.4, 0.0, 0.2], [0.0, -0.7, 0.3, -0.1], [0.1, 0.0, 0.9, 0.5]])
ALL_KEPT = {"dilation_px2": 0.3, "antialiased": False, "alpha_min": 0.0}


def camera_turned(**changes: object) -> PlainCamera:
    """Principal point off centre, uneven focal lengths, a rotated and moved camera."""
    rotation = rotation_matrices([[0.98, 0.1, -0.15, 0.05]])[0]
    pose = np.hstack([rotation, [[0.1], [-0.2], [0.3]]])
    camera = PlainCamera(camera_from_world=pose, fx=45.0, fy=38.0, cx=14.0, cy=13.5)
    return replace(camera, **changes)  # type: ignore[arg-type]


def pixel_of(point_object: Float64Array, instance: PlainInstance, camera: PlainCamera) -> Float64Array:
    """The textbook camera, one point at a time."""
    world = instance.world_from_object[:, :3] @ point_object + instance.world_from_object[:, 3]
    x, y, z = camera.camera_from_world[:, :3] @ world + camera.camera_from_world[:, 3]
    if camera.projection == "orthographic":
        return np.array([camera.fx * x + camera.cx, camera.fy * y + camera.cy])
    return np.array([camera.fx * x / z + camera.cx, camera.fy * y / z + camera.cy])


def covariance_by_differences(instance: PlainInstance, camera: PlainCamera, k: int) -> Float64Array:
    """J Σ Jᵀ with J from central differences along the splat's own axes in object space."""
    cloud, step = instance.cloud, 1e-5
    columns = []
    for axis, scale in zip(rotation_matrices(cloud.rotation[k : k + 1])[0].T, cloud.scale[k], strict=True):
        ahead = pixel_of(cloud.position[k] + step * axis, instance, camera)
        behind = pixel_of(cloud.position[k] - step * axis, instance, camera)
        columns.append((ahead - behind) / (2 * step) * scale)
    root = np.stack(columns, axis=1)
    return root @ root.T


@pytest.mark.parametrize("projection", ["pinhole", "orthographic"])
def test_mean_and_covariance_are_the_camera_and_its_derivative(projection: str) -> None:
    camera = camera_turned(projection=projection)
    instance = PlainInstance(random_cloud(4, 40), SHEAR_AND_MIRROR)
    seen = project(instance, camera, **ALL_KEPT)
    inside = 0
    for row, k in enumerate(seen.index):
        pixel = pixel_of(instance.cloud.position[k], instance, camera)
        assert_allclose(seen.mean_px[row], pixel, rtol=1e-12)
        if projection == "orthographic" or ((pixel >= 0).all() and (pixel <= [camera.width, camera.height]).all()):
            inside += 1
            expected = covariance_by_differences(instance, camera, k) + 0.3 * np.eye(2)
            assert_allclose(seen.covariance_px2[row], expected, rtol=1e-6, atol=1e-7)
    assert inside > 15


def test_quaternion_turns_as_rodrigues_does() -> None:
    axis, angle = np.array([1.0, -2.0, 0.5]) / np.linalg.norm([1.0, -2.0, 0.5]), 0.7
    cross = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    expected = np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross
    quaternion = 3.0 * np.array([np.cos(angle / 2), *(np.sin(angle / 2) * axis)])
    assert_allclose(rotation_matrices([quaternion])[0], expected, atol=1e-15)


def test_sampled_splat_projects_to_the_covariance() -> None:
    """Points drawn from a small splat have the projected mean and covariance (2e5 points: 0.3 % standard error)."""
    camera = camera_turned()
    cloud = cloud_of([[0.1, 0.2, 4.0]], scale=(0.03, 0.01, 0.02), rotation=(0.6, -0.3, 0.7, 0.2))
    instance = PlainInstance(cloud, SHEAR_AND_MIRROR)
    normals = np.random.default_rng(5).normal(size=(200_000, 3)) * cloud.scale[0]
    points = normals @ rotation_matrices(cloud.rotation)[0].T + cloud.position[0]
    world = points @ SHEAR_AND_MIRROR[:, :3].T + SHEAR_AND_MIRROR[:, 3]
    x, y, z = (world @ camera.camera_from_world[:, :3].T + camera.camera_from_world[:, 3]).T
    pixels = np.stack([camera.fx * x / z + camera.cx, camera.fy * y / z + camera.cy])
    seen = project(instance, camera, dilation_px2=0.0, antialiased=False, alpha_min=0.0)
    assert_allclose(np.cov(pixels), seen.covariance_px2[0], rtol=0.015, atol=0.005 * np.trace(seen.covariance_px2[0]))


def only(cloud: PlainCloud, camera: PlainCamera, **changes: object) -> ProjectedSplats:
    return project(PlainInstance(cloud), camera, **(ALL_KEPT | changes))  # type: ignore[arg-type]


@pytest.mark.parametrize("side", [-1.0, 1.0])
@pytest.mark.parametrize("axis", [0, 1])
def test_jacobian_is_held_at_the_frame_plus_the_margin(side: float, axis: int) -> None:
    """Beyond the margin the covariance is the one of a mean on the margin; within it, its own."""
    camera = PlainCamera(cx=10.0, cy=15.0)
    size, centre, focal = ((32, 10.0, 40.0), (24, 15.0, 40.0))[axis]
    edge = (size - centre) / focal if side > 0 else centre / focal
    limit = side * (edge + 0.3 * 0.5 * size / focal)

    def covariance(slope: float) -> Float64Array:
        position = np.array([0.0, 0.0, 3.0])
        position[axis] = 3.0 * slope
        return only(cloud_of([position], scale=(0.3, 0.2, 0.4)), camera).covariance_px2[0]

    assert_allclose(covariance(1.5 * limit), covariance(limit), rtol=1e-12)
    assert not np.allclose(covariance(0.97 * limit), covariance(limit), rtol=1e-4)
    windowed = replace(camera, window=(0, 0, 4, 4))
    far = cloud_of([np.eye(3)[axis] * 6.0 * limit + [0, 0, 3.0]], scale=(0.3, 0.2, 0.4))
    assert_allclose(only(far, windowed).covariance_px2, only(far, camera).covariance_px2)


def test_margin_is_inrias_for_a_centred_principal_point() -> None:
    """INRIA clamps at 1.3 tan(half field of view)."""
    camera = PlainCamera()
    limit = 1.3 * camera.width / (2 * camera.fx)
    beyond = only(cloud_of([[9.0, 0.0, 3.0]], scale=0.5), camera, dilation_px2=0.0).covariance_px2[0]
    jacobian = np.array([[40.0 / 3, 0.0, -40.0 * limit / 3], [0.0, 40.0 / 3, 0.0]])
    assert_allclose(beyond, 0.25 * jacobian @ jacobian.T, rtol=1e-12)


def test_antialiasing_keeps_the_total_opacity() -> None:
    cloud = cloud_of([[0.0, 0.0, 5.0], [0.3, 0.1, 4.0]], scale=[[0.05, 0.02, 0.1], [0.2, 0.3, 0.1]])
    bare, plain = only(cloud, PlainCamera(), dilation_px2=0.0), only(cloud, PlainCamera())
    kept = only(cloud, PlainCamera(), antialiased=True)
    mass_bare = bare.opacity * np.sqrt(np.linalg.det(bare.covariance_px2))
    mass_kept = kept.opacity * np.sqrt(np.linalg.det(kept.covariance_px2))
    assert_allclose(mass_kept, mass_bare, rtol=1e-12)
    assert_allclose(plain.opacity, 0.8)
    flat = cloud_of([[0.0, 0.0, 5.0]], scale=0.0, opacity=1.0)
    assert_allclose(only(flat, PlainCamera(), antialiased=True).opacity, [0.005])


def test_culling() -> None:
    position = [[0, 0, z] for z in (-1.0, 0.2, 0.2001, 9.999, 10.0, 5.0, 5.0, 5.0, 5.0)]
    position += [[np.nan, 0, 5], [50.0, 0, 5]]
    cloud = cloud_of(position)
    cloud.opacity[5] = 0.0039  # below 1/255
    cloud.opacity[6] = np.nan
    cloud.rotation[7] = 0.0
    cloud.scale[8, 1] = np.inf
    seen = only(cloud, PlainCamera(near=0.2, far=10.0), alpha_min=1 / 255)
    assert seen.index.tolist() == [2, 3, 10]


def test_compensated_opacity_below_the_threshold_is_culled() -> None:
    cloud = cloud_of([[0.0, 0.0, 5.0]], scale=1e-4, opacity=0.7)
    assert only(cloud, PlainCamera(), alpha_min=1 / 255).index.tolist() == [0]
    assert only(cloud, PlainCamera(), alpha_min=1 / 255, antialiased=True).index.tolist() == []


def test_view_directions_are_those_of_object_space() -> None:
    camera, instance = camera_turned(), PlainInstance(random_cloud(6, 5), SHEAR_AND_MIRROR)
    rotation, shift = camera.camera_from_world[:, :3], camera.camera_from_world[:, 3]
    eye_object = np.linalg.solve(SHEAR_AND_MIRROR[:, :3], -rotation.T @ shift - SHEAR_AND_MIRROR[:, 3])
    expected = instance.cloud.position - eye_object
    expected /= np.linalg.norm(expected, axis=1, keepdims=True)
    assert_allclose(view_directions(instance, camera, np.arange(5)), expected, atol=1e-14)

    forward = np.linalg.solve(SHEAR_AND_MIRROR[:, :3], rotation[2])
    parallel = view_directions(instance, camera_turned(projection="orthographic"), np.arange(5))
    assert_allclose(parallel, np.tile(forward / np.linalg.norm(forward), (5, 1)), atol=1e-14)
