# SPDX-License-Identifier: GPL-3.0-or-later
"""Beside Blender 5.3's own Gaussian splats: one object, rendered by Stipple and by Cycles, in one process.

    STIPPLE_BLENDER=5.3 STIPPLE_VENV=.venv-5.3 scripts/setup
    .venv-5.3/bin/python scripts/compare_native.py CAPTURE.ply [CAMERAS.json] [--eevee] [--out FOLDER]

Without cameras the capture is looked at as the demo begins. For each engine: processor seconds of the second of two
frames, so that neither compiling nor loading counts; PSNR and SSIM against *sorted*, which is the float64 oracle's
picture to 97 dB, and against *rays*, which like Cycles evaluates each splat along the ray. Over one gray, view
transform Standard.
"""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import bpy
import numpy as np
import numpy.typing as npt
from PIL import Image

import stipple
from stipple.scripts.study import quality

SIZE = (640, 480)
GRAY = 0.2140  # scene-linear, half of what a screen shows
CYCLES_SAMPLES = (16, 64)


@dataclass(frozen=True)
class Candidate:
    """A way to render the object. `settings` are set on the scene: path of a property below it, value."""

    label: str
    engine: str
    settings: tuple[tuple[str, Any], ...]


def candidates(eevee: bool) -> list[Candidate]:
    found = [
        Candidate("Stipple, sorted", "STIPPLE", (("stipple.method", "SORTED"), ("stipple.device", "CPU"))),
        Candidate("Stipple, rays", "STIPPLE", (("stipple.method", "RAYS"),)),
        Candidate("Stipple, points, 64 samples", "STIPPLE", (("stipple.method", "POINTS"), ("stipple.samples", 64))),
    ]
    cycles = (("cycles.device", "CPU"), ("cycles.use_adaptive_sampling", False), ("cycles.use_denoising", False))
    for samples in CYCLES_SAMPLES:
        found.append(Candidate(f"Cycles, {samples} samples", "CYCLES", (*cycles, ("cycles.samples", samples))))
    if eevee:
        found.append(Candidate("EEVEE, 64 samples", "BLENDER_EEVEE", (("eevee.taa_render_samples", 64),)))
    return found


def build_scene(capture: Path, cameras: Path | None) -> Any:
    """Imports with Blender's own operator, so that its engines get what they are used to."""
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    bpy.ops.wm.ply_import(filepath=str(capture))
    b_object, b_scene = bpy.context.view_layer.objects.active, bpy.context.scene
    if b_object is None or getattr(b_object.data, "type", "") != "GAUSSIAN_SPLAT":
        sys.exit(f"{capture}: Blender {bpy.app.version_string} does not import this as Gaussian splats.")
    if cameras is not None:
        bpy.ops.import_scene.splat_cameras(filepath=str(cameras), match_active=True)
    else:
        b_object.rotation_euler = (-np.pi / 2, 0, 0)
        b_scene.camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
        b_scene.collection.objects.link(b_scene.camera)
        b_scene.camera.location, b_scene.camera.rotation_euler = (0.0, -3.2, 0.5), (np.pi / 2, 0, 0)
    b_scene.render.resolution_x, b_scene.render.resolution_y = SIZE
    b_scene.render.dither_intensity = 0.0
    b_scene.view_settings.view_transform = "Standard"
    b_scene.world = bpy.data.worlds.new("Gray")
    b_scene.world.node_tree.nodes["Background"].inputs["Color"].default_value = (GRAY, GRAY, GRAY, 1.0)
    return b_scene


def render(b_scene: Any, candidate: Candidate, folder: Path) -> tuple[npt.NDArray[np.float64], float]:
    """(H, W, 3) as a screen shows it, and processor seconds of the second frame."""
    b_scene.render.engine = candidate.engine
    for path, value in candidate.settings:
        owner, name = path.split(".")
        setattr(getattr(b_scene, owner), name, value)
    b_scene.render.filepath = str(folder / f"{candidate.label.replace(', ', '-').replace(' ', '-')}.png")
    seconds = 0.0
    for _ in range(2):
        begin = time.process_time()
        bpy.ops.render.render(write_still=True)
        seconds = time.process_time() - begin
    with Image.open(b_scene.render.filepath) as picture:
        return np.asarray(picture.convert("RGB"), np.float64) / 255, seconds


def main() -> None:
    parser = argparse.ArgumentParser(prog="compare_native.py", description=str(__doc__).split("\n", maxsplit=1)[0])
    parser.add_argument("capture", type=Path)
    parser.add_argument("cameras", type=Path, nargs="?")
    parser.add_argument("--eevee", action="store_true", help="too; without a GPU it takes minutes")
    parser.add_argument("--out", type=Path, help="where the pictures stay")
    options = parser.parse_args()
    stipple.register()
    b_scene = build_scene(options.capture, options.cameras)
    pictures: dict[str, npt.NDArray[np.float64]] = {}
    with tempfile.TemporaryDirectory() as temporary:
        folder = options.out or Path(temporary)
        folder.mkdir(parents=True, exist_ok=True)
        print("| | core seconds | PSNR, SSIM to sorted | to rays |\n|---|---:|---:|---:|")
        for candidate in candidates(options.eevee):
            pictures[candidate.label], seconds = render(b_scene, candidate, folder)
            cells = [candidate.label, f"{seconds:.2f}"]
            for reference in ("Stipple, sorted", "Stipple, rays"):
                known = reference in pictures and reference != candidate.label
                psnr, ssim = quality(pictures[candidate.label], pictures[reference]) if known else (0.0, 0.0)
                cells.append(f"{psnr:.1f} dB, {ssim:.4f}" if known else "")
            print(f"| {' | '.join(cells)} |", flush=True)
    stipple.unregister()


if __name__ == "__main__":
    main()
    sys.stdout.flush()
    os._exit(0)  # Blender's own teardown in a Python process is not what is measured
