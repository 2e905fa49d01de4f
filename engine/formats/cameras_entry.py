# SPDX-License-Identifier: GPL-3.0-or-later
"""One camera's entry in a JSON file: typed access that names the file, the entry and the key when it fails."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from ..camera import Camera
from ..errors import StippleError

ROTATION_TOLERANCE = 1e-3  # files carry as few as four decimals


@dataclass(frozen=True)
class Entry:
    """A camera that was read, the image it belongs to, and what was left out."""

    camera: Camera
    name: str
    warnings: tuple[str, ...] = ()


class Fields:
    """Keys of one camera, looked up in the entry first and then in what the file says for all of them.

    A key that is null counts as missing. Every getter raises StippleError for a missing key or a value of another kind.
    """

    def __init__(self, path: Path, index: int, *sources: Mapping[str, Any]) -> None:
        self.path = path
        self.index = index
        self._sources = sources

    def has(self, key: str) -> bool:
        return any(source.get(key) is not None for source in self._sources)

    def fail(self, key: str, problem: str) -> StippleError:
        return StippleError(f"{self.path}: camera {self.index}: {key} {problem}.")

    def value(self, key: str) -> Any:
        for source in self._sources:
            if source.get(key) is not None:
                return source[key]
        raise self.fail(key, "is missing; add it to the file")

    def number(self, key: str, default: float | None = None) -> float:
        """A finite number; `default` where the key is absent and a default is given."""
        if default is not None and not self.has(key):
            return default
        value = self.value(key)
        try:
            number = float(value) if isinstance(value, int | float) and not isinstance(value, bool) else np.nan
        except OverflowError:
            number = np.inf
        if not np.isfinite(number):
            raise self.fail(key, f"is {repr(value)[:40]}; give a finite number")
        return number

    def positive(self, key: str, default: float | None = None) -> float:
        value = self.number(key, default)
        if value <= 0:
            raise self.fail(key, f"is {value:g}; give a number above 0")
        return value

    def size(self, key: str) -> int:
        """A whole number of pixels, at least 1; trainers that store it as 640.0 are understood."""
        value = self.positive(key)
        if value != int(value):
            raise self.fail(key, f"is {value:g}; give a whole number of pixels")
        return int(value)

    def matrix(self, key: str, *shapes: tuple[int, ...]) -> npt.NDArray[np.float64]:
        """A finite float64 array of one of `shapes`."""
        try:
            array = np.array(self.value(key), dtype=np.float64)
        except (TypeError, ValueError, OverflowError):
            array = np.empty(0)
        if array.shape not in shapes or not np.isfinite(array).all():
            wanted = " or ".join("×".join(map(str, shape)) for shape in shapes)
            raise self.fail(key, f"must be {wanted} finite numbers")
        return array

    def check_rotation(self, key: str, rotation: npt.NDArray[np.float64]) -> None:
        """A proper rotation up to rounding; a scale or a mirror would silently bend the picture."""
        error = np.abs(rotation @ rotation.T - np.eye(3)).max()
        if error > ROTATION_TOLERANCE or np.linalg.det(rotation) < 0:
            raise self.fail(key, "is not a rotation (orthonormal, determinant +1); normalise it")

    def camera(self, camera_from_world: npt.NDArray[np.float64], **frame: Any) -> Camera:
        """A Camera; its own complaints get the file and the entry put in front."""
        try:
            return Camera(camera_from_world=camera_from_world, **frame)
        except StippleError as error:
            raise StippleError(f"{self.path}: camera {self.index}: {error}") from error


def entry_mapping(path: Path, index: int, entry: object) -> Mapping[str, Any]:
    """`entry` as a JSON object. Raises StippleError when it is something else."""
    if not isinstance(entry, dict):
        raise StippleError(f"{path}: camera {index} is not an object with keys; check how the file was written.")
    return entry


def camera_from_world_of(
    world_from_camera_rotation: npt.NDArray[np.float64], position: Sequence[float] | npt.NDArray[np.float64]
) -> npt.NDArray[np.float64]:
    """(3, 4) inverse of a rotation and a position."""
    rotation = world_from_camera_rotation.T
    return np.hstack([rotation, (-rotation @ np.asarray(position))[:, None]])
