# SPDX-License-Identifier: GPL-3.0-or-later
"""The attributes the oracle reads from a scene and a camera; it calls no method of theirs.

Arrays may be of any float type and are converted to float64. The meaning of each attribute is that of the
engine's dataclass of the same name.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np
import numpy.typing as npt

Float64Array = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]


class SplatCloudLike(Protocol):
    """N splats in object space, activated; `sh_rest` is (N, C, 3) with C = 0, 3, 8, 15 or 24."""

    @property
    def position(self) -> npt.NDArray[np.floating]: ...
    @property
    def scale(self) -> npt.NDArray[np.floating]: ...
    @property
    def rotation(self) -> npt.NDArray[np.floating]: ...
    @property
    def opacity(self) -> npt.NDArray[np.floating]: ...
    @property
    def sh_dc(self) -> npt.NDArray[np.floating]: ...
    @property
    def sh_rest(self) -> npt.NDArray[np.floating]: ...


class InstanceLike(Protocol):
    """A placement of a cloud; `world_from_object` is (3, 4) and any invertible affine map."""

    @property
    def cloud(self) -> SplatCloudLike: ...
    @property
    def world_from_object(self) -> npt.NDArray[np.floating]: ...


class SceneLike(Protocol):
    """Instances in order, and the sRGB-encoded colour behind them (None: transparent)."""

    @property
    def instances(self) -> Sequence[InstanceLike]: ...
    @property
    def background(self) -> Sequence[float] | None: ...


class CameraLike(Protocol):
    """OpenCV camera; `window` is (x, y, width, height) [px] of the rendered part, or None for the whole frame."""

    @property
    def camera_from_world(self) -> npt.NDArray[np.floating]: ...
    @property
    def width(self) -> int: ...
    @property
    def height(self) -> int: ...
    @property
    def fx(self) -> float: ...
    @property
    def fy(self) -> float: ...
    @property
    def cx(self) -> float: ...
    @property
    def cy(self) -> float: ...
    @property
    def near(self) -> float: ...
    @property
    def far(self) -> float: ...
    @property
    def projection(self) -> str: ...
    @property
    def window(self) -> tuple[int, int, int, int] | None: ...
