# SPDX-License-Identifier: GPL-3.0-or-later
"""The camera: where it stands, how it projects, which part of the frame is rendered.

Camera space is OpenCV's: x right, y down, z forward. Pixel coordinates are continuous, with the first pixel's
centre at (0.5, 0.5) and rows counted from the top.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from .errors import StippleError

PROJECTIONS = ("pinhole", "orthographic")
INRIA_NEAR = 0.2  # INRIA's rasteriser skips splats whose mean is nearer than this [world units]


@dataclass(frozen=True, eq=False)
class Camera:
    """A pinhole or orthographic camera.

    - `camera_from_world` (3, 4) float64: rotation and translation.
    - `width`, `height`: the whole frame [px].
    - `fx`, `fy`: focal length [px]; for an orthographic camera, pixels per world unit.
    - `cx`, `cy`: principal point [px].
    - `near`, `far`: clipping distances of splat means along z [world units].
    - `window`: (x, y, width, height) of the part that is rendered [px, from the top left], None for all of it.
      A window changes no pixel's value: it only leaves the others out.

    Does not model lens distortion. Raises StippleError for an impossible frame, focal length or clipping range.
    """

    camera_from_world: npt.NDArray[np.float64]
    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float
    near: float = INRIA_NEAR
    far: float = 1e6
    projection: str = "pinhole"
    window: tuple[int, int, int, int] | None = None

    def __post_init__(self) -> None:
        if np.shape(self.camera_from_world) != (3, 4) or not np.isfinite(self.camera_from_world).all():
            raise StippleError("camera: camera_from_world must be a finite 3×4 matrix.")
        if self.projection not in PROJECTIONS:
            raise StippleError(f"camera: projection is {self.projection!r}; choose pinhole or orthographic.")
        if not (self.width > 0 and self.height > 0):
            raise StippleError(f"camera: the frame is {self.width}×{self.height} px; give at least 1×1.")
        if not (self.fx > 0 and self.fy > 0 and np.isfinite([self.fx, self.fy, self.cx, self.cy]).all()):
            raise StippleError(f"camera: focal length {self.fx}, {self.fy} px; give positive finite values.")
        if not self.near < self.far or (self.projection == "pinhole" and self.near <= 0):
            raise StippleError(f"camera: clipping from {self.near} to {self.far}; start above 0 and end beyond it.")
        x, y, w, h = self.rendered_window
        if x < 0 or y < 0 or w < 1 or h < 1 or x + w > self.width or y + h > self.height:
            raise StippleError(f"camera: the window {self.window} leaves the {self.width}×{self.height} px frame.")

    @property
    def rendered_window(self) -> tuple[int, int, int, int]:
        """(x, y, width, height) of the rendered part [px]."""
        return self.window or (0, 0, self.width, self.height)

    @property
    def position(self) -> npt.NDArray[np.float64]:
        """The camera's place in the world, (3,)."""
        linear, translation = self.camera_from_world[:, :3], self.camera_from_world[:, 3]
        return -np.linalg.solve(linear, translation)  # a sheared parent leaves it no rotation

    def project(self, points_world: npt.ArrayLike) -> npt.NDArray[np.float64]:
        """World points (N, 3) to (x [px], y [px], depth along z [world units]), (N, 3) float64; no clipping."""
        points = np.atleast_2d(np.asarray(points_world, dtype=np.float64))
        in_camera = points @ self.camera_from_world[:, :3].T + self.camera_from_world[:, 3]
        z = in_camera[:, 2]
        scale = 1.0 / z if self.projection == "pinhole" else np.ones_like(z)
        x = self.fx * in_camera[:, 0] * scale + self.cx
        y = self.fy * in_camera[:, 1] * scale + self.cy
        return np.stack([x, y, z], axis=1)

    def resized(self, width: int, height: int) -> Camera:
        """The same view in a frame of another size: fits the old frame's height, as the field of view of a lens."""
        factor = height / self.height
        return replace(
            self,
            width=width,
            height=height,
            fx=self.fx * factor,
            fy=self.fy * factor,
            cx=width / 2 + (self.cx - self.width / 2) * factor,
            cy=height / 2 + (self.cy - self.height / 2) * factor,
            window=None,
        )


def look_at(eye: npt.ArrayLike, target: npt.ArrayLike, up: npt.ArrayLike = (0.0, -1.0, 0.0)) -> npt.NDArray[np.float64]:
    """`camera_from_world` (3, 4) of a camera at `eye` that looks at `target` with `up` upwards in the picture.

    Raises StippleError when the view direction is zero or parallel to `up`.
    """
    eye, target, up = (np.asarray(v, dtype=np.float64) for v in (eye, target, up))
    forward = target - eye
    right = np.cross(forward, up)
    if np.linalg.norm(right) < 1e-12 * max(1.0, float(np.linalg.norm(forward))):
        raise StippleError("camera: cannot look along the up direction; move the camera or choose another up axis.")
    z = forward / np.linalg.norm(forward)
    x = right / np.linalg.norm(right)
    rotation = np.stack([x, np.cross(z, x), z])
    return np.hstack([rotation, (-rotation @ eye)[:, None]])
