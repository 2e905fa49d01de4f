# SPDX-License-Identifier: GPL-3.0-or-later
"""Measure the renderer: a table on the terminal, JSON in a file. `scripts/bench` runs it.

Needs Warp, NumPy and plyfile only. Every stage waits for the device, so a stage's time is its own. Medians are over
`--repeats` frames after one that compiles and uploads. On a CPU, core times are the threads' processor time added up,
which other work on the machine hardly changes. For *rays*, vertex and fill work are told apart; where its graphics
driver is not the device, both are printed.

    scripts/bench --device cpu --json bench.json
    scripts/bench --preset sample --method points --supersampling 2 --threads 1
    scripts/bench --preset city-25m --path 12 --plot path.svg --size 1280x720
    scripts/bench --device cuda:0 --json gpu.json --compare bench.json
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import warp as wp

from stipple.engine import device as engine_device
from stipple.engine.errors import StippleError
from stipple.engine.renderer import Renderer
from stipple.engine.settings import CULLING, METHODS, STORAGE, Settings
from stipple.scripts.bench_compare import comparison
from stipple.scripts.bench_edit import measure_editing
from stipple.scripts.bench_machine import machine, measured_rates
from stipple.scripts.bench_path import measure_path
from stipple.scripts.bench_plot import plot_paths
from stipple.scripts.bench_presets import LARGE_PRESETS, PRESETS, ROOT, SMALL_PRESETS
from stipple.scripts.bench_print import print_path, print_row
from stipple.scripts.bench_quality import time_to_quality
from stipple.scripts.bench_rays import vertex_and_fill
from stipple.scripts.bench_rows import measure

QUALITY_SPLATS = 2_000_000  # up to so many, the time to 40 dB is measured unless it is asked for


def size_of(text: str) -> tuple[int, int]:
    width, height = text.lower().replace("×", "x").split("x")
    return int(width), int(height)


def parse(arguments: list[str] | None) -> argparse.Namespace:
    texts = "\n".join(f"  {name:14} {preset.text}" for name, preset in PRESETS.items())
    parser = argparse.ArgumentParser(
        prog="scripts/bench",
        description="Measure the renderer: stages, rates, memory, culling, quality.",
        epilog=f"presets:\n{texts}",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add = parser.add_argument
    add("--preset", choices=PRESETS, action="append", help="may be repeated; default: the small ones")
    add("--large", action="store_true", help="copies of 1, 6 and 25 M splats instead, with all methods")
    add("--method", choices=METHODS, action="append", help="may be repeated; default: all, points for generated scenes")
    add("--device", default="auto", help="auto (default), cpu or cuda:N")
    add("--size", type=size_of, default=(1920, 1080), metavar="WxH", help="of the picture [px]; default: 1920x1080")
    add("--supersampling", type=int, default=1)
    add("--points-per-thread", type=int, default=1, help="K of points")
    add("--culling", choices=CULLING, default="occlusion")
    add("--storage", choices=STORAGE, default="full", help="of captures; generated scenes are always quantised")
    add("--repeats", type=int, default=7)
    add("--threads", type=int, default=engine_device.thread_count(), help="on a CPU; default: all")
    add("--cold", action="store_true", help="compile all kernels anew, so that first frames include it")
    add("--quality", action=argparse.BooleanOptionalAction, help="time to 40 dB; default: up to 2 M splats")
    add("--edit", type=float, nargs="?", const=137.0, metavar="MILLIONS", help="measure editing instead, up to so many")
    add("--path", type=int, nargs="?", const=12, metavar="STEPS", help="also measure points along the camera path")
    add("--plot", type=Path, metavar="FILE.svg", help="where to draw that")
    add("--json", type=Path, default=ROOT / "bench.json", metavar="FILE")
    add("--compare", type=Path, metavar="OTHER.json", help="print ratios to an earlier measurement")
    return parser.parse_args(arguments)


def measure_preset(renderer: Renderer, name: str, options: argparse.Namespace) -> dict[str, Any] | None:
    """One row per method, and "path" in the row of points where asked; None if the preset's files are absent."""
    begin = time.perf_counter()
    opened = PRESETS[name].open()
    open_seconds = time.perf_counter() - begin
    if opened is None:
        print(f"{name:14} skipped: what it needs is not here")
        return None
    rows: dict[str, Any] = {}
    camera = opened.path.camera(0.0, options.size)
    for method in options.method or (METHODS if options.large else PRESETS[name].methods):
        settings = Settings(
            method=method,
            samples=1,
            supersampling=options.supersampling,
            points_per_thread=options.points_per_thread,
            culling=options.culling,
            storage=options.storage,
        )
        try:
            row = measure(renderer, opened.scene, camera, settings, options.repeats, open_seconds)
            row["made_from"] = opened.made_from
            wanted = row["splats"] <= QUALITY_SPLATS if options.quality is None else options.quality
            if method == "points" and wanted:
                row["quality"] = time_to_quality(renderer, opened.scene, camera, options.supersampling)
            if method == "rays":
                row |= vertex_and_fill(renderer, opened.scene, camera, settings, options.repeats)
            print_row(name, method, row)
            if method == "points" and options.path:
                runs = min(options.repeats, 3)
                row["path"] = measure_path(renderer, opened, options.size, settings, options.path, runs)
                print_path(name, row["path"])
        except StippleError as error:
            print(f"{name:14} {method:7} skipped: {error}")
            continue
        rows[method] = row
    return rows


def main(arguments: list[str] | None = None) -> None:
    options = parse(arguments)
    engine_device.set_thread_count(options.threads)
    if options.cold:
        wp.config.kernel_cache_dir = tempfile.mkdtemp(prefix="stipple-kernels-")
    other = json.loads(options.compare.read_text()) if options.compare else None
    renderer = Renderer(options.device, synchronise_stages=True)
    result: dict[str, Any] = {
        "machine": {**machine(renderer.device), "measured": measured_rates(renderer.device)},
        "size": list(options.size),
        "repeats": options.repeats,
        "kernels": "compiled anew" if options.cold else "as cached",
        "presets": {},
    }
    print(", ".join(f"{key} {value}" for key, value in result["machine"].items() if key != "measured"))
    print(", ".join(f"{name} {rate / 1e9:.3g} G" for name, rate in result["machine"]["measured"].items()))
    names = LARGE_PRESETS if options.large else options.preset or SMALL_PRESETS
    if options.edit is not None:
        names, result["editing"] = (), measure_editing(renderer.device, options.repeats, options.edit)
    for name in names:
        rows = measure_preset(renderer, name, options)
        if rows is not None:
            result["presets"][name] = rows
        renderer.free()
    options.json.write_text(json.dumps(result, indent=1) + "\n")
    print(f"written to {options.json}", file=sys.stderr)
    paths = {
        name: rows["points"]["path"] for name, rows in result["presets"].items() if "path" in rows.get("points", {})
    }
    if options.plot and paths:
        options.plot.write_text(plot_paths(paths, "frame_ms" if renderer.device.is_cuda else "frame_core_ms"))
        print(f"drawn to {options.plot}", file=sys.stderr)
    if other is not None:
        print("\n".join(comparison(result, other)))


if __name__ == "__main__":
    main()
