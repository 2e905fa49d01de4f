# SPDX-License-Identifier: GPL-3.0-or-later
"""The guide's screenshots, made again from the real program: the project's sample, cut to what matters.

    STIPPLE_DESKTOP=COMMAND .venv/bin/python scripts/guide_pictures.py [SCENE …]

Needs the extension in dist/ (scripts/build --platform linux_x64); tests/desktop/program.py says how the program is
found. The other pictures of docs/images are renders, or were photographed by hand or by tests/desktop.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from pathlib import Path

from PIL import Image

from stipple.engine.formats import write_splats
from stipple.scripts.sample_capture import build_sample
from stipple.tests.desktop import program

WINDOW = Path(__file__).with_name("guide_pictures_window.py")
OUTPUT = program.ROOT / "bench-output" / "guide"
IMAGES = program.ROOT / "docs" / "images"
Box = tuple[int, int, int, int]

# Of each scene: pictures by name, made of parts of screenshots [px: left, top, right, bottom] side by side.
PICTURES: dict[str, dict[str, tuple[tuple[str, Box], ...]]] = {
    "first": {
        "first-menu.png": (("menu", (0, 0, 640, 545)),),
        "first-importer.png": (("importer", (140, 340, 560, 550)),),
    },
    "panels": {
        "first-rendered.jpg": (("rendered", (0, 0, 1280, 800)),),
        "render-panel.png": (("sorted", (878, 168, 1278, 776)),),
        "render-panel-points.png": (("points", (878, 168, 1278, 776)),),
    },
    "final": {
        "final-camera.jpg": (("camera", (0, 27, 1280, 776)),),
        "final-output.png": (("output", (878, 168, 1278, 700)),),
        "final-render.jpg": (("final", (0, 0, 1280, 800)),),
    },
    "crop": {"crop.jpg": (("crop", (0, 27, 1280, 776)),)},
    "grade": {
        "grade.jpg": (("captured", (150, 220, 720, 705)), ("graded", (150, 220, 720, 705))),
        "grade-panel.png": (("graded", (880, 440, 1278, 620)),),
    },
    "cube": {
        "viewport-alignment.jpg": (
            ("cube-persp", (230, 150, 660, 570)),
            ("cube-ortho", (230, 150, 660, 570)),
            ("cube-camera", (180, 150, 700, 570)),
        )
    },
}
GAP = 4  # [px]


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument(
        "scenes", nargs="*", default=[], metavar="SCENE", help=f"of {', '.join(PICTURES)}; default: all"
    )
    parser.add_argument("--only-cut", action="store_true", help="cut the screenshots of the last time again")
    options = parser.parse_args()
    OUTPUT.mkdir(parents=True, exist_ok=True)
    capture = Path(tempfile.gettempdir()) / "captures" / "forest-floor.ply"  # a path that a picture may show
    capture.parent.mkdir(exist_ok=True)
    if not capture.exists():
        write_splats(capture, build_sample())
    for scene in options.scenes or PICTURES:
        folder = OUTPUT / scene
        folder.mkdir(exist_ok=True)
        if not options.only_cut:
            try:
                program.run(WINDOW, scene, folder, str(capture))
            except (program.NotHere, program.Failed) as error:
                print(f"guide_pictures: {error}", file=sys.stderr)
                return 1
        for name, parts in PICTURES[scene].items():
            cut(folder, parts).save(IMAGES / name, optimize=True, quality=88)
            print(IMAGES / name)
    return 0


def cut(folder: Path, parts: tuple[tuple[str, Box], ...]) -> Image.Image:
    """Parts of screenshots side by side."""
    pieces = [Image.open(folder / f"{shot}.png").convert("RGB").crop(box) for shot, box in parts]
    width = sum(piece.width for piece in pieces) + GAP * (len(pieces) - 1)
    picture = Image.new("RGB", (width, max(piece.height for piece in pieces)), "white")
    left = 0
    for piece in pieces:
        picture.paste(piece, (left, 0))
        left += piece.width + GAP
    return picture


if __name__ == "__main__":
    sys.exit(main())
