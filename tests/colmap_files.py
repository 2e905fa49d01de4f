# SPDX-License-Identifier: GPL-3.0-or-later
"""Writes COLMAP's sparse models from its documentation, for tests; shares no code with the engine's reader."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from stipple.engine.camera import Camera

MODEL_NUMBERS = {
    "SIMPLE_PINHOLE": 0,
    "PINHOLE": 1,
    "SIMPLE_RADIAL": 2,
    "RADIAL": 3,
    "OPENCV": 4,
    "OPENCV_FISHEYE": 5,
    "FULL_OPENCV": 6,
    "FOV": 7,
    "THIN_PRISM_FISHEYE": 10,
    "RAD_TAN_THIN_PRISM_FISHEYE": 11,
    "EQUIRECTANGULAR": 17,
}


@dataclass(frozen=True)
class Lens:
    """A line of cameras.txt."""

    id: int
    model: str
    width: int
    height: int
    parameters: tuple[float, ...]


@dataclass(frozen=True)
class View:
    """Two lines of images.txt; points are (x, y, id of the 3D point)."""

    id: int
    quaternion: tuple[float, ...]
    translation: tuple[float, ...]
    lens_id: int
    name: str
    points: tuple[tuple[float, float, int], ...] = ()


def view_of(number: int, camera: Camera, name: str, lens_id: int = 1, length: float = 1.0) -> View:
    """The view of a camera: its quaternion is the null vector of R(q) − R, written as a linear system in q."""
    rotation = camera.camera_from_world[:, :3]
    rows = []
    for vector in np.eye(3):  # q ∘ v = (R v) ∘ q for every v
        rows.append(_left_minus_right(rotation @ vector, vector))
    _, _, vh = np.linalg.svd(np.vstack(rows))
    return View(number, tuple(length * vh[-1]), tuple(camera.camera_from_world[:, 3]), lens_id, name)


def _left_minus_right(turned: np.ndarray, vector: np.ndarray) -> np.ndarray:
    """The 4×4 matrix of q -> (0, turned) ∘ q − q ∘ (0, vector)."""
    (a, b, c), (x, y, z) = turned, vector
    left = np.array([[0, -a, -b, -c], [a, 0, -c, b], [b, c, 0, -a], [c, -b, a, 0]])
    right = np.array([[0, -x, -y, -z], [x, 0, z, -y], [y, -z, 0, x], [z, y, -x, 0]])
    return left - right


def write_text(folder: Path, lenses: Sequence[Lens], views: Sequence[View]) -> Path:
    """cameras.txt and images.txt."""
    folder.mkdir(parents=True, exist_ok=True)
    cameras = [f"{lens.id} {lens.model} {lens.width} {lens.height} {_words(lens.parameters)}\n" for lens in lenses]
    images = []
    for view in views:
        images.append(f"{view.id} {_words((*view.quaternion, *view.translation))} {view.lens_id} {view.name}\n")
        images.append(" ".join(f"{x} {y} {point}" for x, y, point in view.points) + "\n")
    (folder / "cameras.txt").write_text("".join(cameras))
    (folder / "images.txt").write_text("".join(images))
    return folder


def write_binary(folder: Path, lenses: Sequence[Lens], views: Sequence[View]) -> Path:
    """cameras.bin and images.bin."""
    folder.mkdir(parents=True, exist_ok=True)
    cameras = struct.pack("<Q", len(lenses))
    for lens in lenses:
        cameras += struct.pack("<IiQQ", lens.id, MODEL_NUMBERS[lens.model], lens.width, lens.height)
        cameras += struct.pack(f"<{len(lens.parameters)}d", *lens.parameters)
    images = struct.pack("<Q", len(views))
    for view in views:
        images += struct.pack("<I7dI", view.id, *view.quaternion, *view.translation, view.lens_id)
        images += view.name.encode() + b"\0" + struct.pack("<Q", len(view.points))
        for x, y, point in view.points:
            images += struct.pack("<ddq", x, y, point)
    (folder / "cameras.bin").write_bytes(cameras)
    (folder / "images.bin").write_bytes(images)
    return folder


def _words(numbers: Sequence[float]) -> str:
    return " ".join(repr(float(number)) for number in numbers)
