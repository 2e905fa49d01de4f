# SPDX-License-Identifier: GPL-3.0-or-later
"""Measure the renderer's stages at 1920×1080: a table on the terminal, JSON in a file. `scripts/bench` runs it.

Needs Warp, NumPy and plyfile only. Every stage waits for the device, so a stage's time is its own. Medians are over
`--repeats` frames after one that compiles and warms up. On a CPU, a rate "per core" is work per core second of the
stage (the threads' processor time added up), which other work on the machine hardly changes. For *rays*, vertex and
fill work are told apart; where its graphics driver is not the device, both are printed.

    scripts/bench --device cpu --json bench.json
    scripts/bench --preset sample --method points --supersampling 2 --threads 1
    scripts/bench --device cuda:0 --large
"""

from __future__ import annotations

import argparse
import json
import platform
import statistics
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import warp as wp

from stipple.engine import device as engine_device
from stipple.engine.camera import Camera, look_at
from stipple.engine.errors import StippleError
from stipple.engine.formats import read_splats
from stipple.engine.formats.cameras_file import read_cameras
from stipple.engine.rays.host import Draw
from stipple.engine.renderer import Frame, Renderer
from stipple.engine.scene import Instance, Scene
from stipple.engine.settings import METHODS, Settings
from stipple.engine.splats import ARRAY_NAMES, SplatCloud
from stipple.scripts.bench_edit import measure_editing
from stipple.scripts.sample_capture import build_sample

ROOT = Path(__file__).resolve().parent.parent
REAL = ROOT.parent / "shared" / "data" / "real"
SIZE = (1920, 1080)
# The stage whose speed is quoted, and what it works on.
RATES = {"points": ("splat", "points"), "sorted": ("blend", "blends"), "rays": ("draw", "quads")}

HALVES = ("vertex", "fill")  # of a draw of rays
SOFTWARE_DRIVER = "llvmpipe"  # draws on the processor's cores


@dataclass(frozen=True)
class Preset:
    """A scene and a camera to measure. `load` returns None where a file it needs is absent."""

    text: str
    load: Callable[[], tuple[SplatCloud, Camera] | None]


def sample(splat_count: int) -> tuple[SplatCloud, Camera]:
    """The project's own sample, as on the README."""
    width, height = SIZE
    focal = 0.5 * height / np.tan(np.radians(30.0) / 2)
    pose = look_at((0.9, -1.12, -2.95), (0.03, -0.41, 0.0))
    return build_sample(splat_count), Camera(pose, width, height, focal, focal, width / 2, height / 2, near=0.05)


def forest(splat_count: int) -> tuple[SplatCloud, Camera]:
    """Copies of the sample in a square, seen from one corner: distinct splats, for the memory's sake."""
    tile, pitch = build_sample(250_000), 2.3  # its own size
    copies = max(1, round(splat_count / tile.splat_count))
    side = int(np.ceil(np.sqrt(copies)))
    arrays = {name: np.concatenate([getattr(tile, name)] * copies) for name in ARRAY_NAMES}
    place = np.arange(copies)
    shift = np.column_stack([place % side, np.zeros(copies), place // side]) * pitch
    arrays["position"] += np.repeat(shift, tile.splat_count, axis=0).astype(np.float32)
    width, height = SIZE
    focal, middle = 0.5 * height / np.tan(np.radians(40.0) / 2), pitch * (side - 1) / 2
    reach = pitch * side
    pose = look_at((middle + 0.5 * reach, -0.6 * reach, middle - 1.1 * reach), (middle, -0.4, middle))
    return SplatCloud(**arrays), Camera(pose, width, height, focal, focal, width / 2, height / 2, near=0.05)


def koala() -> tuple[SplatCloud, Camera] | None:
    if not REAL.is_dir():
        return None
    camera = read_cameras(REAL / "koala_cameras.json")[0].resized(*SIZE)
    return read_splats(REAL / "koala.ply").cloud, camera


PRESETS = {
    "koala": Preset("54,804 splats, a real capture, SH degree 0 (skipped without ../shared)", koala),
    "sample": Preset("260,000 splats, the project's own sample, SH degree 3", lambda: sample(260_000)),
    "playbot-sized": Preset("500,000 splats, the same sample, denser", lambda: sample(500_000)),
}
LARGE = {
    f"forest-{million}M": Preset(
        f"{million} M splats, copies of the sample side by side", partial(forest, million * 10**6)
    )
    for million in (1, 5, 25)
}


def measure(renderer: Renderer, cloud: SplatCloud, camera: Camera, settings: Settings, repeats: int) -> dict[str, Any]:
    """Stage medians [ms] and rates of one method; each repeat is a frame of one sample per subpixel."""
    scene = Scene((Instance(cloud),))
    renderer.render(scene, camera, settings)
    # A near plane that differs by a millionth shows the same splats, but no frame can take the order of the one before.
    cameras = [replace(camera, near=camera.near * (1.0 + 1e-6 * k)) for k in range(1, repeats + 1)]
    frames = [renderer.render(scene, view, settings).stats for view in cameras]
    stage, unit = RATES[settings.method]
    work = {"points": frames[0].points, "blends": frames[0].blends, "quads": frames[0].splats_visible}[unit]
    rates = sorted(work / stats.stage_seconds[stage] for stats in frames)
    core_rates = [work / stats.stage_core_seconds[stage] for stats in frames]
    totals = sorted(1e3 * stats.seconds for stats in frames)
    return {
        "splats": cloud.splat_count,
        "splats_visible": frames[0].splats_visible,
        "supersampling": settings.supersampling,
        "frame_ms": statistics.median(totals),
        "frame_p95_ms": totals[min(len(totals) - 1, int(0.95 * len(totals)))],
        "stages_ms": {
            name: statistics.median(1e3 * stats.stage_seconds[name] for stats in frames)
            for name in frames[0].stage_seconds
        },
        unit: work,
        "rate_per_second": statistics.median(rates),
        "rate_per_core_second": None if renderer.device.is_cuda else statistics.median(core_rates),
        "buffer_bytes": frames[0].peak_bytes,
    }


def vertex_and_fill(
    renderer: Renderer, cloud: SplatCloud, camera: Camera, settings: Settings, repeats: int
) -> dict[str, Any]:
    """Milliseconds and splats per second of the two halves of a draw of *rays*, by the clock and by core seconds.

    Three draws in turn, medians of each: of nothing (clearing and reading back), of all quads moved out of the
    picture, which does the vertex work and fills no pixel, and of the picture. Their differences are the halves.
    """
    frame = Frame(renderer, Scene((Instance(cloud),)), camera, settings)
    host = renderer.raster().host
    picture: Draw = frame.method.draw_of(0)  # type: ignore[attr-defined]
    fx, fy, cx, cy = picture.constants["lens"]
    beside = replace(picture, constants=picture.constants | {"lens": (fx, fy, cx + 1e9, cy)})
    times: list[list[tuple[float, float]]] = []
    for _ in range(repeats + 1):
        times.append([])
        for draw in (replace(picture, splat_count=0), beside, picture):
            begin, begin_core = time.perf_counter(), time.process_time()
            host.draw(draw)
            times[-1].append((time.perf_counter() - begin, time.process_time() - begin_core))
    result = {}
    halves = np.median(np.diff(np.array(times[1:]), axis=1), axis=0).tolist()
    for name, (seconds, core_seconds) in zip(HALVES, halves, strict=True):
        result[f"{name}_ms"] = 1e3 * seconds
        result[f"{name}_splats_per_second"] = picture.splat_count / seconds
        on_cores = SOFTWARE_DRIVER in host.name  # type: ignore[attr-defined]
        result[f"{name}_splats_per_core_second"] = picture.splat_count / core_seconds if on_cores else None
    return result


def machine(renderer: Renderer) -> dict[str, Any]:
    return {
        "device": renderer.device.name,
        "processor": processor_name(),
        "threads": engine_device.thread_count(),
        "python": platform.python_version(),
        "warp": wp.__version__,
        "system": platform.platform(),
    }


def processor_name() -> str:
    table = Path("/proc/cpuinfo")
    if table.exists():
        for line in table.read_text().splitlines():
            if line.startswith("model name"):
                return line.split(":", 1)[1].strip()
    return platform.processor()


def print_row(preset: str, method: str, row: dict[str, Any]) -> None:
    _, unit = RATES[method]
    stages = "  ".join(f"{name} {ms:.1f}" for name, ms in row["stages_ms"].items())
    per_core = row["rate_per_core_second"]
    print(
        f"{preset:14} {method:7} {row['frame_ms']:8.1f} ms  {row[unit] / 1e6:8.1f} M {unit}  "
        f"{row['rate_per_second'] / 1e6:7.3g} M/s{f'  {per_core / 1e6:7.3g} M/s per core' if per_core else ''}\n"
        f"{'':22} {stages}"
    )
    if "vertex_ms" in row:
        for half in HALVES:
            per_core = row[f"{half}_splats_per_core_second"]
            print(
                f"{'':22} {half} {row[f'{half}_ms']:.1f} ms  {row[f'{half}_splats_per_second'] / 1e6:.3g} M splats/s"
                f"{f'  {per_core / 1e6:.3g} M/s per core' if per_core else ''}  on {row['graphics']}"
            )


def parse() -> argparse.Namespace:
    texts = "\n".join(f"  {name:14} {preset.text}" for name, preset in PRESETS.items())
    parser = argparse.ArgumentParser(
        prog="scripts/bench",
        description="Measure the renderer's stages at 1920×1080.",
        epilog=f"presets:\n{texts}",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--preset", choices=PRESETS, action="append", help="may be repeated; default: all")
    parser.add_argument("--large", action="store_true", help="1, 5 and 25 M splats instead of the presets")
    parser.add_argument("--method", choices=METHODS, action="append", help="may be repeated; default: all")
    parser.add_argument("--device", default="auto", help="auto (default), cpu or cuda:N")
    parser.add_argument("--supersampling", type=int, default=1)
    parser.add_argument("--repeats", type=int, default=7)
    parser.add_argument("--threads", type=int, default=engine_device.thread_count(), help="on a CPU; default: all")
    parser.add_argument(
        "--edit",
        type=float,
        nargs="?",
        const=137.0,
        metavar="MILLIONS",
        help="measure editing instead, up to so many splats",
    )
    parser.add_argument("--json", type=Path, default=ROOT / "bench.json", metavar="FILE")
    return parser.parse_args()


def main() -> None:
    options = parse()
    engine_device.set_thread_count(options.threads)
    renderer = Renderer(options.device, synchronise_stages=True)
    result: dict[str, Any] = {"machine": machine(renderer), "size": SIZE, "repeats": options.repeats, "presets": {}}
    print(", ".join(f"{key} {value}" for key, value in result["machine"].items()))
    presets = LARGE if options.large else {name: PRESETS[name] for name in options.preset or PRESETS}
    if options.edit is not None:
        presets, result["editing"] = {}, measure_editing(renderer.device, options.repeats, options.edit)
    for name, preset in presets.items():
        loaded = preset.load()
        if loaded is None:
            print(f"{name:14} skipped: its files are not here")
            continue
        rows = result["presets"][name] = {}
        for method in options.method or METHODS:
            settings = Settings(method=method, samples=1, supersampling=options.supersampling)
            try:
                rows[method] = measure(renderer, *loaded, settings, options.repeats)
                if method == "rays":
                    rows[method] |= vertex_and_fill(renderer, *loaded, settings, options.repeats)
                    rows[method]["graphics"] = renderer.raster().host.name
            except StippleError as error:
                print(f"{name:14} {method:7} skipped: {error}")
                continue
            print_row(name, method, rows[method])
    options.json.write_text(json.dumps(result, indent=1) + "\n")
    print(f"written to {options.json}", file=sys.stderr)


if __name__ == "__main__":
    main()
