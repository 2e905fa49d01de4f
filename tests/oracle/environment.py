# SPDX-License-Identifier: GPL-3.0-or-later
"""What is seen behind the splats where an equirectangular image surrounds the scene, in float64."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from .scene_like import CameraLike, Float64Array


def view_directions(camera: CameraLike, subpixels: int = 1) -> Float64Array:
    """Unit directions in the world, (H · s, W · s, 3), of rays through the centres of s × s subpixels of the window."""
    left, top, width, height = camera.window or (0, 0, camera.width, camera.height)
    x = left + (np.arange(width * subpixels) + 0.5) / subpixels
    y = top + (np.arange(height * subpixels) + 0.5) / subpixels
    grid_x, grid_y = np.meshgrid(x, y)
    rays = np.stack([(grid_x - camera.cx) / camera.fx, (grid_y - camera.cy) / camera.fy, np.ones_like(grid_x)], axis=-1)
    if camera.projection == "orthographic":
        rays[..., :2] = 0
    linear = np.asarray(camera.camera_from_world, np.float64)[:, :3]
    world = np.einsum("ij,hwj->hwi", np.linalg.inv(linear), rays)
    return world / np.linalg.norm(world, axis=-1, keepdims=True)


def light_along(pixels: npt.ArrayLike, directions: Float64Array) -> Float64Array:
    """Bilinear light along (…, 3) vectors in the image's space: zenith +z, centre +x, −y to the right of it.

    Longitude and latitude are placed on the image's axes by their angles; columns close around, rows end at the poles.
    """
    image = np.asarray(pixels, np.float64)
    rows, columns, _ = image.shape
    azimuth = np.arctan2(-directions[..., 1], directions[..., 0])  # to the right of the centre
    elevation = np.arcsin(np.clip(directions[..., 2] / np.linalg.norm(directions, axis=-1), -1, 1))
    x = (azimuth + np.pi) * columns / (2 * np.pi) - 0.5
    y = (np.pi / 2 - elevation) * rows / np.pi - 0.5
    total = np.zeros(directions.shape)
    for row in (np.floor(y), np.floor(y) + 1):
        for column in (np.floor(x), np.floor(x) + 1):
            weight = (1 - np.abs(x - column)) * (1 - np.abs(y - row))
            texel = image[np.clip(row, 0, rows - 1).astype(int), np.mod(column, columns).astype(int)]
            total += weight[..., None] * texel
    return total


def light_behind(
    pixels: npt.ArrayLike,
    environment_from_world: npt.ArrayLike,
    strength: float,
    camera: CameraLike,
    subpixels: int = 1,
) -> Float64Array:
    """Scene-linear light (H, W, 3) that reaches each pixel of the camera's window."""
    affine = np.asarray(environment_from_world, np.float64)
    directions = view_directions(camera, subpixels) @ affine[:, :3].T + affine[:, 3]
    light = strength * light_along(pixels, directions)
    height, width = light.shape[0] // subpixels, light.shape[1] // subpixels
    return light.reshape(height, subpixels, width, subpixels, 3).mean(axis=(1, 3))


def display_from_light(light: Float64Array) -> Float64Array:
    """The sRGB curve of IEC 61966-2-1, going on above 1 and mirrored below 0."""
    size = np.abs(light)
    curve = np.where(size > 0.0031308, 1.055 * np.maximum(size, 1e-300) ** (1 / 2.4) - 0.055, 12.92 * size)
    return np.copysign(curve, light)
