# SPDX-License-Identifier: GPL-3.0-or-later
"""Render the pictures of the README and docs/ from the project's own sample.

.venv/bin/python scripts/pictures.py
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from PIL import Image

from stipple.engine.camera import Camera, look_at
from stipple.engine.colour import bytes_from_display
from stipple.engine.renderer import Renderer
from stipple.engine.scene import Instance, Scene
from stipple.engine.settings import Settings
from stipple.scripts.sample_capture import build_sample

IMAGES = Path(__file__).resolve().parent.parent / "docs" / "images"
PAPER = (0.83, 0.82, 0.78)  # sRGB-encoded backgrounds
NIGHT = (0.11, 0.115, 0.105)
STRIP_SAMPLES = (1, 4, 16, 64)


def camera(
    eye: tuple[float, float, float], target: tuple[float, float, float], degrees: float, size: tuple[int, int]
) -> Camera:
    """A camera with a vertical field of view [degrees] and a size [px]."""
    focal = 0.5 * size[1] / np.tan(np.radians(degrees) / 2)
    return Camera(look_at(eye, target), *size, focal, focal, size[0] / 2, size[1] / 2, near=0.05)


def save(rgba: np.ndarray, name: str) -> None:
    """A palette would band; JPEG at 92 is a fifth of the PNG and shows no difference at this size."""
    Image.fromarray(bytes_from_display(rgba)[..., :3]).save(IMAGES / name, quality=92)
    print(IMAGES / name)


def main() -> None:
    IMAGES.mkdir(parents=True, exist_ok=True)
    cloud = build_sample()
    renderer = Renderer()
    fine = Settings(method="sorted", supersampling=3)
    light, dark = (Scene((Instance(cloud),), background) for background in (PAPER, NIGHT))
    front = camera((0.9, -1.12, -2.95), (0.03, -0.41, 0.0), 30, (1280, 720))
    save(renderer.render(light, front, fine).rgba, "sample.jpg")
    close = camera((-0.62, -0.72, -1.85), (-0.02, -0.36, -0.2), 32, (1280, 720))
    save(renderer.render(dark, close, fine).rgba, "close.jpg")
    detail = camera((-0.62, -0.72, -1.85), (0.02, -0.3, -0.35), 15, (320, 360))
    strip = [renderer.render(dark, detail, Settings(samples=samples)).rgba for samples in STRIP_SAMPLES]
    strip.append(renderer.render(dark, detail, Settings(method="sorted")).rgba)
    save(np.concatenate(strip, axis=1), "points.jpg")


if __name__ == "__main__":
    main()
