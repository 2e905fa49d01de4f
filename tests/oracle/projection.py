# SPDX-License-Identifier: GPL-3.0-or-later
"""EWA projection of splats as INRIA's 3DGS rasteriser does it, in float64.

Camera space is OpenCV's (x right, y down, z forward); pixel coordinates are continuous with the first pixel's
centre at (0.5, 0.5). Sources: Zwicker et al., "EWA Splatting", 2002; Kerbl et al., "3D Gaussian Splatting", 2023.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from .scene_like import CameraLike, Float64Array, InstanceLike, IntArray

COMPENSATION_FLOOR = 0.000025  # INRIA's lower bound of det before / det after the dilation
CLAMP_MARGIN = 0.3  # INRIA's 1.3 · tan(half field of view), written as a margin beyond the frame's edge


@dataclass(frozen=True, eq=False)
class ProjectedSplats:
    """The V splats of one instance that survive culling, in the cloud's order.

    - `index` (V,) int64: which splat of the cloud.
    - `mean_px` (V, 2), `depth` (V,) camera-space z [world units], `covariance_px2` (V, 2, 2) after dilation.
    - `opacity` (V,): after the compensation for the dilation, where that is asked for.
    """

    index: IntArray
    mean_px: Float64Array
    covariance_px2: Float64Array
    depth: Float64Array
    opacity: Float64Array


@np.errstate(divide="ignore", invalid="ignore")
def rotation_matrices(quaternions: npt.ArrayLike) -> Float64Array:
    """(N, 3, 3) rotations of quaternions (N, 4) in the order w, x, y, z, normalised here; NaN where one is zero."""
    q = np.asarray(quaternions, dtype=np.float64)
    w, x, y, z = (q / np.linalg.norm(q, axis=1, keepdims=True)).T
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.moveaxis(np.array(rows), 2, 0)


def camera_from_object(instance: InstanceLike, camera: CameraLike) -> Float64Array:
    """(3, 4): the instance's affine map followed by the camera's rigid one."""
    outer = np.asarray(camera.camera_from_world, dtype=np.float64)
    inner = np.asarray(instance.world_from_object, dtype=np.float64)
    return np.hstack([outer[:, :3] @ inner[:, :3], (outer[:, :3] @ inner[:, 3] + outer[:, 3])[:, None]])


def view_directions(instance: InstanceLike, camera: CameraLike, index: IntArray) -> Float64Array:
    """(V, 3) unit vectors in object space along which the splats `index` are seen, for spherical harmonics.

    From the camera's place to the mean; the camera's forward axis for an orthographic camera. Raises
    numpy.linalg.LinAlgError for an instance flattened to a plane: it has no object-space camera.
    """
    affine = camera_from_object(instance, camera)
    object_from_camera = np.linalg.inv(affine[:, :3])
    if camera.projection == "orthographic":
        towards = np.broadcast_to(object_from_camera[:, 2], (len(index), 3))
    else:
        camera_in_object = -object_from_camera @ affine[:, 3]
        towards = np.asarray(instance.cloud.position, dtype=np.float64)[index] - camera_in_object
    return towards / np.linalg.norm(towards, axis=1, keepdims=True)


def jacobians(mean_camera: Float64Array, camera: CameraLike) -> Float64Array:
    """(V, 2, 3): derivative of the pixel position by the camera-space position, at the clamped mean.

    x/z and y/z are held to the full frame plus 0.3 of its half field of view on each side, as gsplat does; with a
    centred principal point that is INRIA's ±1.3 tan(half field of view). A render window does not change it.
    """
    result = np.zeros((len(mean_camera), 2, 3))
    if camera.projection == "orthographic":
        result[:, 0, 0], result[:, 1, 1] = camera.fx, camera.fy
        return result
    z = mean_camera[:, 2]
    axes = ((camera.fx, camera.cx, camera.width), (camera.fy, camera.cy, camera.height))
    for axis, (focal, centre, size) in enumerate(axes):
        margin = CLAMP_MARGIN * 0.5 * size / focal
        slope = np.clip(mean_camera[:, axis] / z, -(centre / focal + margin), (size - centre) / focal + margin)
        result[:, axis, axis] = focal / z
        result[:, axis, 2] = -focal * slope / z
    return result


@np.errstate(divide="ignore", invalid="ignore", over="ignore")  # what is not finite is left out below
def project(
    instance: InstanceLike, camera: CameraLike, *, dilation_px2: float, antialiased: bool, alpha_min: float
) -> ProjectedSplats:
    """Project one instance's splats.

    Leaves out: means with z <= near or z >= far, opacities (after compensation) below `alpha_min`, and whatever is
    not finite or has no inverse covariance. It does not cull against the frame: a splat outside may reach in.
    """
    cloud, affine = instance.cloud, camera_from_object(instance, camera)
    mean_camera = np.asarray(cloud.position, dtype=np.float64) @ affine[:, :3].T + affine[:, 3]
    index = np.flatnonzero((mean_camera[:, 2] > camera.near) & (mean_camera[:, 2] < camera.far))
    mean_camera, opacity = mean_camera[index], np.asarray(cloud.opacity, dtype=np.float64)[index]

    axes_object = rotation_matrices(np.asarray(cloud.rotation)[index])
    axes_object = axes_object * np.asarray(cloud.scale, dtype=np.float64)[index][:, None, :]
    root_px = jacobians(mean_camera, camera) @ affine[:, :3] @ axes_object  # (V, 2, 3): J A R S
    covariance = root_px @ root_px.transpose(0, 2, 1)
    undilated = np.linalg.det(covariance)
    covariance = covariance + dilation_px2 * np.eye(2)
    determinant = np.linalg.det(covariance)
    if antialiased:
        opacity = opacity * np.sqrt(np.maximum(COMPENSATION_FLOOR, undilated / determinant))

    pinhole = camera.projection != "orthographic"
    flat = mean_camera[:, :2] / mean_camera[:, 2:] if pinhole else mean_camera[:, :2]
    mean_px = flat * (camera.fx, camera.fy) + (camera.cx, camera.cy)
    finite = np.isfinite(mean_px).all(axis=1) & np.isfinite(covariance).all(axis=(1, 2)) & np.isfinite(opacity)
    keep = np.flatnonzero(finite & (determinant > 0) & (opacity >= alpha_min))
    return ProjectedSplats(index[keep], mean_px[keep], covariance[keep], mean_camera[keep, 2], opacity[keep])
