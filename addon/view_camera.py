# SPDX-License-Identifier: GPL-3.0-or-later
"""A 3D viewport's view as an engine Camera.

Everything comes from the matrices that Blender draws its overlays with, so that splats lie under the outlines exactly,
in perspective, orthographic and camera views with any shift, zoom and offset.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ..engine.camera import Camera
from ..engine.errors import StippleError
from .camera import OPENCV_FROM_BLENDER, camera_from_world, check_lens

ROUNDING = 1e-5  # of float32 matrices that were inverted once, relative
FAR = 1e6  # [world units], where float32 leaves no better number in the matrix
Matrix = tuple[tuple[float, ...], ...]
Rect = tuple[float, float, float, float]  # left, bottom, right, top as fractions of the region
WHOLE: Rect = (0.0, 0.0, 1.0, 1.0)


@dataclass(frozen=True)
class ViewportView:
    """What a viewport looks at: plain values that compare equal as long as the picture would be the same.

    - `window`: Blender's 4×4 matrix from view to clip space.
    - `camera_from_world`: 3×4, in the engine's axes.
    - `width`, `height` of the region [px].
    - `border`: the part that is rendered, as fractions of the region from the bottom left.
    """

    window: Matrix
    camera_from_world: Matrix
    width: int
    height: int
    border: Rect = WHOLE

    @property
    def orthographic(self) -> bool:
        return self.window[3][3] == 1.0

    def camera(self, divider: int = 1) -> Camera:
        """The camera, its frame `divider` times smaller than the region on both sides (rounded up, never cropped).

        Clip coordinates become pixels by the frame's own size, so the smaller picture, stretched over the region, is
        aligned as exactly as the full one.
        """
        width, height = -(-self.width // divider), -(-self.height // divider)
        window = np.array(self.window, np.float64)
        scale_x, scale_y = window[0, 0] * width / 2, window[1, 1] * height / 2
        # A perspective matrix shifts in its third column, in proportion to −z; an orthographic one in its last.
        shift_x, shift_y = window[:2, 3] if self.orthographic else -window[:2, 2]
        near, far = self._clipping(window)
        return Camera(
            camera_from_world=np.array(self.camera_from_world, np.float64),
            width=width,
            height=height,
            fx=scale_x,
            fy=scale_y,
            cx=(1 + shift_x) * width / 2,
            cy=(1 - shift_y) * height / 2,
            near=near,
            far=far,
            projection="orthographic" if self.orthographic else "pinhole",
            window=self._window(width, height),
        )

    def _clipping(self, window: np.ndarray) -> tuple[float, float]:
        a, b = window[2, 2], window[2, 3]
        if self.orthographic:
            near, far = (1 + b) / a, (b - 1) / a
            return (-near, -far) if near > far else (near, far)
        near = b / (a - 1)
        far = b / (a + 1) if a < -1 else FAR
        return near, far if far > near else FAR

    def _window(self, width: int, height: int) -> tuple[int, int, int, int] | None:
        if self.border == WHOLE:
            return None
        left, bottom, right, top = self.border
        x, y = min(int(left * width), width - 1), min(int((1 - top) * height), height - 1)
        return x, y, max(1, round((right - left) * width)), max(1, round((top - bottom) * height))


def view_of(context: Any, b_scene: Any) -> ViewportView:
    """The view of the context's region, with the border of the camera or of the viewport where one is in use.

    Raises StippleError through a camera that a final render refuses: Blender's matrices are of a perspective one then.
    """
    b_region, b_region_3d, b_space = context.region, context.region_data, context.space_data
    window, view = np.array(b_region_3d.window_matrix), np.array(b_region_3d.view_matrix)
    from_world = OPENCV_FROM_BLENDER @ view[:3].astype(np.float64)
    border = WHOLE
    if b_region_3d.view_perspective == "CAMERA":
        b_camera = b_space.camera if b_space.use_local_camera else b_scene.camera
        if b_camera is not None and b_camera.type == "CAMERA":
            check_lens(b_camera)
            from_world = _exact(from_world, b_camera)
            if b_scene.render.use_border:
                border = _camera_border(b_camera, b_scene, window @ view)
    elif b_space.use_render_border:
        border = _fractions(b_space, "render_border_")
    return ViewportView(_rows(window), _rows(from_world), b_region.width, b_region.height, _inside(border))


def _exact(from_world: np.ndarray, b_camera: Any) -> np.ndarray:
    """The matrix a final render uses, where it is the viewport's but for rounding.

    Splats at nearly equal depth are sorted by the last bits: with these the viewport equals the final render.
    """
    try:
        final = camera_from_world(b_camera.matrix_world, b_camera.name)
    except StippleError:
        return from_world
    size = 1 + float(np.abs(final).max())
    return final if np.allclose(final, from_world, rtol=0, atol=ROUNDING * size) else from_world


def _camera_border(b_camera: Any, b_scene: Any, clip_from_world: np.ndarray) -> Rect:
    """The render region within the camera's frame, as fractions of the region; WHOLE where the frame has no place."""
    frame = np.array([(*corner, 1.0) for corner in b_camera.data.view_frame(scene=b_scene)])
    axes = np.array(b_camera.matrix_world.normalized())
    clip = frame @ axes.T @ clip_from_world.T
    if (clip[:, 3] <= 0).any():
        return WHOLE
    x, y = ((clip[:, :2] / clip[:, 3:]).T + 1) / 2
    left, bottom, right, top = _fractions(b_scene.render, "border_")
    width, height = x.max() - x.min(), y.max() - y.min()
    return (
        float(x.min() + left * width),
        float(y.min() + bottom * height),
        float(x.min() + right * width),
        float(y.min() + top * height),
    )


def _fractions(b_owner: Any, prefix: str) -> Rect:
    left, bottom, right, top = (getattr(b_owner, prefix + name) for name in ("min_x", "min_y", "max_x", "max_y"))
    return left, bottom, right, top


def _inside(border: Rect) -> Rect:
    """The border cut to the region; WHOLE when nothing of it is inside, so that there always is a picture."""
    left, bottom, right, top = (min(max(value, 0.0), 1.0) for value in border)
    return (left, bottom, right, top) if right > left and top > bottom else WHOLE


def _rows(b_matrix: Any) -> Matrix:
    return tuple(tuple(float(value) for value in row) for row in b_matrix)
