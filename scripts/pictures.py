# SPDX-License-Identifier: GPL-3.0-or-later
"""Render the pictures of the README and docs/ from the project's own sample.

    .venv/bin/python scripts/pictures.py
    .venv/bin/python scripts/pictures.py --playbot FILE.ply

The second makes the pictures of *playbot* instead (S. Agullo, CC-BY-4.0), from its level 0.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

import numpy as np
from PIL import Image

from stipple.engine.camera import Camera, look_at
from stipple.engine.colour import bytes_from_display
from stipple.engine.formats import read_splats
from stipple.engine.look import Crop, Look
from stipple.engine.renderer import Renderer
from stipple.engine.scene import Environment, EnvironmentImage, Instance, Scene
from stipple.engine.settings import Settings
from stipple.engine.splats import SH_C0, SplatCloud
from stipple.scripts.sample_capture import build_sample

IMAGES = Path(__file__).resolve().parent.parent / "docs" / "images"
PAPER = (0.83, 0.82, 0.78)  # sRGB-encoded backgrounds
NIGHT = (0.11, 0.115, 0.105)
OVERCAST = (0.75, 0.78, 0.8)
STRIP_SAMPLES = (1, 4, 16, 64)
HALF_BOX = Crop(((2.0, 0.0, 0.0, 0.0), (0.0, 2.0, 0.0, 0.0), (0.0, 0.0, 2.0, 2.05)))  # what lies behind z = 0.05
LOOKS = (  # two rows: the whole sample, a detail of it
    (Look(), Look(gain=(0.85, 0.95, 1.3), exposure=-0.9, saturation=0.8), Look(crops=(HALF_BOX,))),
    (Look(), Look(display="points", point_px=5.0), Look(display="ellipsoids")),
)


def camera(
    eye: tuple[float, float, float], target: tuple[float, float, float], degrees: float, size: tuple[int, int]
) -> Camera:
    """A camera with a vertical field of view [degrees] and a size [px]."""
    focal = 0.5 * size[1] / np.tan(np.radians(degrees) / 2)
    return Camera(look_at(eye, target), *size, focal, focal, size[0] / 2, size[1] / 2, near=0.05)


def evening() -> Environment:
    """Scene-linear sky and ground with the sun low behind the sample; the sample's up is −y."""
    rows, columns = 1024, 2048
    elevation = (0.5 - (np.arange(rows) + 0.5) / rows)[:, None, None] * np.pi
    azimuth = ((np.arange(columns) + 0.5) / columns - 0.5)[None, :, None] * 2 * np.pi
    high = np.clip(elevation / 0.9, 0, 1) ** 0.6
    sky = np.array([1.1, 0.52, 0.24]) * (1 - high) + np.array([0.1, 0.19, 0.42]) * high
    ground = np.array([0.09, 0.07, 0.06]) * np.exp(np.minimum(elevation, 0) * 2)
    light = np.where(elevation > 0, sky, ground) + 0 * azimuth
    away = np.hypot(azimuth + 0.2, elevation - 0.12)  # of the sun [rad], near enough
    light = light + np.array([1.0, 0.6, 0.3]) * (
        1.2 * np.exp(-away / 0.22) + 60.0 * np.clip((0.027 - away) / 0.004, 0, 1)
    )
    pixels = np.ascontiguousarray(light, np.float32)
    return Environment(EnvironmentImage(pixels), ((0, 0, 1, 0), (-1, 0, 0, 0), (0, -1, 0, 0)))


def save(rgba: np.ndarray, name: str) -> None:
    """A palette would band; JPEG at 92 is a fifth of the PNG and shows no difference at this size."""
    Image.fromarray(bytes_from_display(rgba)[..., :3]).save(IMAGES / name, quality=92)
    print(IMAGES / name)


def water(level: float) -> SplatCloud:
    """A pond at height `level` as a capture has it: flat, soft splats of 0.08 units, in no order."""
    rng = np.random.default_rng(11)
    across = np.arange(-1.5, 1.5, 0.06)
    places = np.stack(np.meshgrid(across, across), -1).reshape(-1, 2)
    places = places[np.hypot(*places.T) < 1.45]
    x, z = rng.permutation(places + rng.uniform(-0.02, 0.02, places.shape)).T
    count = len(x)
    colour = np.array([0.16, 0.36, 0.42]) + rng.normal(0.0, 0.015, (count, 1))
    arrays = {
        "position": np.column_stack([x, np.full(count, -level), z]),
        "scale": np.tile([0.08, 1e-4, 0.08], (count, 1)),
        "rotation": np.tile([1.0, 0.0, 0.0, 0.0], (count, 1)),
        "opacity": np.full(count, 0.7),
        "sh_dc": (colour - 0.5) / SH_C0,
        "sh_rest": np.zeros((count, 0, 3)),
    }
    return SplatCloud(**{name: np.ascontiguousarray(values, np.float32) for name, values in arrays.items()})


def crossing_captures(renderer: Renderer, cloud: SplatCloud) -> None:
    """*rays*: the sample standing in a pond, in sorted order and in stochastic order."""
    scene = Scene((Instance(cloud), Instance(water(0.2))), PAPER)
    view = camera((0.5, -0.85, -2.3), (0.0, -0.25, 0.0), 26, (640, 480))
    orders = (Settings(method="rays", supersampling=2), Settings(method="rays", ray_order="stochastic", samples=256))
    save(np.concatenate([renderer.render(scene, view, order).rgba for order in orders], axis=1), "rays-crossing.jpg")


def close_up(renderer: Renderer, path: Path) -> None:
    """*sorted* and *rays* from among playbot's plants, a hand's breadth above the ground."""
    scene = Scene((Instance(read_splats(path).cloud),), OVERCAST)
    view = replace(camera((0.4524, -0.0359, -0.6065), (0.0517, -0.4106, 0.0), 75, (640, 480)), near=0.01)
    pair = [
        renderer.render(scene, view, Settings(method=method, supersampling=3)).rgba for method in ("sorted", "rays")
    ]
    save(np.concatenate(pair, axis=1), "rays-close-up.jpg")


def contact_sheet(cloud: SplatCloud, renderer: Renderer) -> np.ndarray:
    """What settings of objects do, see `LOOKS`."""
    size, settings = (426, 320), Settings(method="sorted", supersampling=2)
    whole = camera((0.9, -1.12, -2.95), (0.03, -0.36, 0.0), 33, size)
    detail = camera((-0.62, -0.72, -1.85), (0.08, -0.29, -0.35), 9, size)
    rows = [
        [renderer.render(Scene((Instance(cloud, look=look),), PAPER), view, settings).rgba for look in looks]
        for view, looks in zip((whole, detail), LOOKS, strict=True)
    ]
    return np.concatenate([np.concatenate(row, axis=1) for row in rows])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--playbot", type=Path, metavar="FILE")
    options = parser.parse_args()
    IMAGES.mkdir(parents=True, exist_ok=True)
    renderer = Renderer()
    if options.playbot:
        close_up(renderer, options.playbot)
        return
    cloud = build_sample()
    fine = Settings(method="sorted", supersampling=3)
    light, dark = (Scene((Instance(cloud),), background) for background in (PAPER, NIGHT))
    front = camera((0.9, -1.12, -2.95), (0.03, -0.41, 0.0), 30, (1280, 720))
    save(renderer.render(light, front, fine).rgba, "sample.jpg")
    low = camera((-0.5, -0.62, -2.9), (0.05, -0.5, 0.0), 38, (1280, 560))
    save(renderer.render(Scene(light.instances, evening()), low, fine).rgba, "world.jpg")
    close = camera((-0.62, -0.72, -1.85), (-0.02, -0.36, -0.2), 32, (1280, 720))
    save(renderer.render(dark, close, fine).rgba, "close.jpg")
    detail = camera((-0.62, -0.72, -1.85), (0.02, -0.3, -0.35), 15, (320, 360))
    strip = [renderer.render(dark, detail, Settings(samples=samples)).rgba for samples in STRIP_SAMPLES]
    strip.append(renderer.render(dark, detail, Settings(method="sorted")).rgba)
    save(np.concatenate(strip, axis=1), "points.jpg")
    crossing_captures(renderer, cloud)
    save(contact_sheet(cloud, renderer), "objects.jpg")


if __name__ == "__main__":
    main()
