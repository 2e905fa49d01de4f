# SPDX-License-Identifier: GPL-3.0-or-later
"""Render an animation in the background as `blender -b … -a` does; time and memory of every frame, JSON in a file.

    .venv/bin/python scripts/bench_frames.py                          # 100 frames of the project's sample at 1080p
    .venv/bin/python scripts/bench_frames.py --capture walk.0001.ply --sequence --method POINTS

A frame's time has three parts: *engine* is the renderer's own, *addon* is reading the scene and handing over the
picture, *blender* is what Blender does around it: evaluating the scene, color management, compressing and writing the
file.
"""

from __future__ import annotations

import argparse
import json
import os
import statistics
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import bpy
import numpy as np

import stipple
from stipple.addon import render_engine
from stipple.addon.splat_data import datablock_from_cloud
from stipple.engine.formats import write_splats
from stipple.scripts.sample_capture import build_sample

SETTLED = 3  # frames after which memory must not grow any more
SAMPLE_SPLATS = 260_000
UNITS = ("s", "core_s")


class Clock:
    """How long every frame took, and how much memory the process has after it."""

    def __init__(self) -> None:
        self.frames: list[dict[str, float]] = []
        self._begun = self._engine = self._render = np.zeros(2)
        pictures, render_view_layer = render_engine._pictures, render_engine.render_view_layer

        def timed_pictures(*arguments: Any) -> Iterator[Any]:
            begin = now()
            for picture in pictures(*arguments):
                self._engine = self._engine + now() - begin
                yield picture
                begin = now()

        def timed_render(*arguments: Any) -> None:
            begin, self._engine = now(), np.zeros(2)
            render_view_layer(*arguments)
            self._render = now() - begin

        render_engine._pictures, render_engine.render_view_layer = timed_pictures, timed_render
        bpy.app.handlers.render_pre.append(self._started)
        bpy.app.handlers.render_write.append(self._written)

    def _started(self, *_: object) -> None:
        self._begun = now()

    def _written(self, *_: object) -> None:
        parts = {
            "engine": self._engine,
            "addon": self._render - self._engine,
            "blender": now() - self._begun - self._render,
        }
        frame = {
            f"{name}_{unit}": float(t) for name, part in parts.items() for unit, t in zip(UNITS, part, strict=True)
        }
        self.frames.append({**frame, "resident_bytes": resident_bytes()})


def now() -> np.ndarray:
    """Wall seconds, and processor seconds of all threads, which other work on the machine hardly changes."""
    return np.array([time.perf_counter(), time.process_time()])


def resident_bytes() -> int:
    """Memory of this process that is in use [bytes]; Linux only."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE")


def build_scene(options: argparse.Namespace, folder: Path) -> None:
    """A capture that turns before a still camera."""
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    b_scene = bpy.context.scene
    b_scene.render.engine = "STIPPLE"
    if options.capture:
        bpy.ops.import_scene.splats(filepath=str(options.capture), sequence=options.sequence)
        b_object = bpy.context.view_layer.objects.active
    elif options.sequence:
        for number in range(1, 1 + options.sequence_files):
            cloud = build_sample(options.splats + 1000 * (number % 7), seed=number)
            write_splats(folder / f"sample.{number:04d}.ply", cloud)
        bpy.ops.import_scene.splats(filepath=str(folder / "sample.0001.ply"), sequence=True)
        b_object = bpy.context.view_layer.objects.active
        b_object.stipple_sequence.loop = "REPEAT"
    else:
        b_object = bpy.data.objects.new("Sample", datablock_from_cloud(build_sample(options.splats), "Sample"))
        b_object.rotation_euler = (-np.pi / 2, 0, 0)
        b_scene.collection.objects.link(b_object)
    for frame, turn in ((1, 0.0), (options.frames + 1, 2 * np.pi)):
        b_object.rotation_euler.z = turn
        b_object.keyframe_insert("rotation_euler", frame=frame)
    b_camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    b_scene.collection.objects.link(b_camera)
    b_camera.location, b_camera.rotation_euler = (0.0, -3.2, 0.5), (np.pi / 2, 0, 0)
    b_scene.camera = b_camera


def render(options: argparse.Namespace, folder: Path) -> list[dict[str, float]]:
    b_scene = bpy.context.scene
    b_scene.frame_start, b_scene.frame_end = 1, options.frames
    b_scene.render.resolution_x, b_scene.render.resolution_y = options.size
    b_scene.render.image_settings.file_format = options.format
    b_scene.render.filepath = str(folder / "frame") + os.sep
    b_scene.stipple.method, b_scene.stipple.samples = options.method, options.samples
    b_scene.stipple.device, b_scene.stipple.supersampling = options.device, options.supersampling
    clock = Clock()
    bpy.ops.render.render(animation=True)
    return clock.frames


def summary(frames: list[dict[str, float]]) -> dict[str, float]:
    """Medians over the frames after `SETTLED`, and how far memory then strays from where it was."""
    settled = frames[SETTLED:]
    median = {name: statistics.median(frame[name] for frame in settled) for name in frames[0]}
    memory = [frame["resident_bytes"] for frame in settled]
    shares = {
        f"addon_share_{unit}": median[f"addon_{unit}"] / (median[f"engine_{unit}"] + median[f"addon_{unit}"])
        for unit in UNITS
    }
    return {
        **median,
        **shares,
        "resident_bytes": memory[0],
        "largest_growth_bytes": max(memory) - memory[0],
        "last_growth_bytes": memory[-1] - memory[0],
    }


def parse() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="bench_frames.py", description=str(__doc__).split("\n", maxsplit=1)[0])
    parser.add_argument("--capture", type=Path, help="a splat file; default: the project's sample")
    parser.add_argument(
        "--sequence", action="store_true", help="play the numbered files beside it, or numbered samples"
    )
    parser.add_argument("--sequence-files", type=int, default=10, help="of the sample")
    parser.add_argument("--splats", type=int, default=SAMPLE_SPLATS, help="of the sample")
    parser.add_argument("--frames", type=int, default=100)
    parser.add_argument("--size", type=lambda text: tuple(map(int, text.split("x"))), default=(1920, 1080))
    parser.add_argument("--method", choices=("SORTED", "POINTS", "RAYS"), default="SORTED")
    parser.add_argument("--samples", type=int, default=16)
    parser.add_argument("--supersampling", type=int, default=1)
    parser.add_argument("--device", choices=("AUTO", "CPU", "CUDA"), default="AUTO")
    parser.add_argument("--format", choices=("PNG", "OPEN_EXR", "JPEG"), default="PNG")
    parser.add_argument("--json", type=Path, metavar="FILE")
    return parser.parse_args()


def main() -> None:
    options = parse()
    stipple.register()
    with tempfile.TemporaryDirectory() as folder:
        build_scene(options, Path(folder))
        frames = render(options, Path(folder))
    result = {"options": vars(options), "summary": summary(frames), "frames": frames}
    if options.json:
        options.json.write_text(json.dumps(result, indent=1, default=str) + "\n")
    for name, value in result["summary"].items():  # type: ignore[attr-defined]
        print(f"{name:22} {value / 2**20:10.1f} MiB" if name.endswith("bytes") else f"{name:22} {value:10.3f}")
    stipple.unregister()


if __name__ == "__main__":
    main()
    sys.stdout.flush()
    os._exit(0)  # Blender's own teardown in a Python process is not what is measured
