# SPDX-License-Identifier: GPL-3.0-or-later
"""Render a preview of each preset that may be shown: the sample, the city, and playbot with its credit.

    .venv/bin/python scripts/preview_presets.py [PRESET …]

Writes docs/images/preset-NAME.jpg: the camera path's beginning on the left, its end on the right. Other captures are
test data that no picture may show; copies of playbot are credited as playbot is.
"""

from __future__ import annotations

import sys

import numpy as np
from PIL import Image

from stipple.engine.colour import bytes_from_display
from stipple.engine.renderer import Renderer
from stipple.engine.scene import Scene
from stipple.engine.settings import Settings
from stipple.scripts.bench_presets import PRESETS, ROOT

IMAGES = ROOT / "docs" / "images"
SIZE = (480, 270)
SUPERSAMPLING = 4  # a sample reads every splat once, whatever its subpixels
SAMPLES = {"near": 8, "far": 2}
PAPER = (0.83, 0.82, 0.78)  # sRGB-encoded, behind captures
HIDDEN = ("koala",)


def preview(renderer: Renderer, name: str) -> None:
    opened = PRESETS[name].open()
    if opened is None:
        print(f"{name}: skipped, what it needs is not here")
        return
    scene = Scene(opened.scene.instances, opened.scene.background or PAPER)
    views = []
    for t, samples in ((0.0, SAMPLES["near"]), (1.0, SAMPLES["far"])):
        settings = Settings(samples=samples, supersampling=SUPERSAMPLING)
        views.append(renderer.render(scene, opened.path.camera(t, SIZE), settings).rgba)
    path = IMAGES / f"preset-{name}.jpg"
    Image.fromarray(bytes_from_display(np.concatenate(views, axis=1))[..., :3]).save(path, quality=88)
    print(path)
    renderer.free()


def main() -> None:
    names = sys.argv[1:] or [name for name in PRESETS if name not in HIDDEN]
    renderer = Renderer()
    for name in names:
        if name in HIDDEN:
            print(f"{name}: may not be shown")
            continue
        preview(renderer, name)


if __name__ == "__main__":
    main()
