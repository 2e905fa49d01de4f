# SPDX-License-Identifier: GPL-3.0-or-later
"""Camera paths that start close and pull away (Gaussian Point Splatting, doi 10.1145/3811272, §4.2)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from stipple.engine.camera import Camera, look_at

Point = npt.ArrayLike


@dataclass(frozen=True)
class CameraPath:
    """From a near to a far view: place and target [world units], −y up. `fov_y` is vertical [degrees]."""

    near_eye: Point
    near_target: Point
    far_eye: Point
    far_target: Point
    fov_y: float = 50.0
    clip_near: float = 0.05
    clip_far: float = 1e6

    def camera(self, t: float, size: tuple[int, int]) -> Camera:
        """At `t` from 0 (near) to 1 (far): the distance grows by equal factors in equal steps."""
        targets = np.array([self.near_target, self.far_target], np.float64)
        polar = [_polar(np.subtract(eye, at)) for eye, at in zip((self.near_eye, self.far_eye), targets, strict=True)]
        (near, far), turn = polar, (polar[1][1] - polar[0][1] + np.pi) % (2 * np.pi) - np.pi
        distance = near[0] ** (1 - t) * far[0] ** t
        azimuth, elevation = near[1] + t * turn, (1 - t) * near[2] + t * far[2]
        # The target moves as the view widens, or it would leave a near view at once.
        share = (distance - near[0]) / (far[0] - near[0]) if far[0] != near[0] else t
        target = (1 - share) * targets[0] + share * targets[1]
        around = np.array(
            [np.cos(elevation) * np.sin(azimuth), -np.sin(elevation), np.cos(elevation) * np.cos(azimuth)]
        )
        width, height = size
        focal = 0.5 * height / np.tan(np.radians(self.fov_y) / 2)
        pose = look_at(target + distance * around, target)
        return Camera(pose, width, height, focal, focal, width / 2, height / 2, near=self.clip_near, far=self.clip_far)


def _polar(offset: npt.NDArray[np.float64]) -> tuple[float, float, float]:
    """Distance, azimuth and elevation [rad]."""
    distance = float(np.linalg.norm(offset))
    return distance, float(np.arctan2(offset[0], offset[2])), float(np.arcsin(-offset[1] / distance))
