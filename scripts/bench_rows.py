# SPDX-License-Identifier: GPL-3.0-or-later
"""Measure frames of one scene from one place: stages, rates, memory, the first frame, and what culling leaves out."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from typing import Any

from stipple.engine.camera import Camera
from stipple.engine.film import RenderStats
from stipple.engine.renderer import Renderer
from stipple.engine.scene import Scene
from stipple.engine.settings import Settings
from stipple.scripts.bench_machine import p95, peak_process_bytes
from stipple.scripts.bench_memory import memory

# The stage whose speed is quoted, and what it works on.
RATES = {"points": ("splat", "points"), "sorted": ("blend", "blends"), "rays": ("draw", "quads")}
CULLING_REPEATS = 3  # frames without occlusion culling, which are slow where it matters


@dataclass(frozen=True)
class Timed:
    """What a frame did and how long all of it took, reading the picture back included; `core` over all threads [s]."""

    stats: RenderStats
    seconds: float
    core: float


def timed_frame(renderer: Renderer, scene: Scene, camera: Camera, settings: Settings) -> Timed:
    begin, begin_core = time.perf_counter(), time.process_time()
    stats = renderer.render(scene, camera, settings).stats
    return Timed(stats, time.perf_counter() - begin, time.process_time() - begin_core)


def timed_frames(
    renderer: Renderer, scene: Scene, camera: Camera, settings: Settings, repeats: int
) -> tuple[Timed, list[Timed]]:
    """The first frame, which compiles and uploads, and `repeats` more, for each of which culling has a memory.

    A near plane that differs by a millionth shows the same splats, but no frame can take the order of the one before.
    """
    first = timed_frame(renderer, scene, camera, settings)
    cameras = [replace(camera, near=camera.near * (1.0 + 1e-6 * k)) for k in range(1, repeats + 1)]
    return first, [timed_frame(renderer, scene, view, settings) for view in cameras]


def measure(
    renderer: Renderer, scene: Scene, camera: Camera, settings: Settings, repeats: int, open_seconds: float
) -> dict[str, Any]:
    """One method's row; each repeat is a frame of one sample per subpixel. `open_seconds` made the scene."""
    first, frames = timed_frames(renderer, scene, camera, settings, repeats)
    row: dict[str, Any] = {
        "splats": scene.splat_count,
        "sh_degree": max(instance.cloud.sh_degree for instance in scene.instances),
        "splats_visible": frames[-1].stats.splats_visible,
        "supersampling": settings.supersampling,
        "culling": settings.culling,
        "storage": settings.storage,
        "frame_ms": 1e3 * statistics.median(frame.seconds for frame in frames),
        "frame_p95_ms": 1e3 * p95([frame.seconds for frame in frames]),
        "frame_core_ms": 1e3 * statistics.median(frame.core for frame in frames),
        **_stages([frame.stats for frame in frames]),
        **_rates([frame.stats for frame in frames], settings.method, renderer),
        **_memory(renderer, scene, settings),
        "first_frame": {
            "open_seconds": open_seconds,
            "upload_seconds": first.stats.stage_seconds["upload"],
            "seconds": open_seconds + first.seconds,
            "core_seconds": first.core,
        },
    }
    if settings.method == "points" and settings.culling == "occlusion":
        row["culling_gain"] = culling_gain(renderer, scene, camera, settings, min(repeats, CULLING_REPEATS), row)
    return row


def _stages(stats: list[RenderStats]) -> dict[str, dict[str, float]]:
    def each(reduce: Callable[[list[float]], float], times: Callable[[RenderStats], dict[str, float]]) -> dict:
        return {name: 1e3 * reduce([times(stat)[name] for stat in stats]) for name in times(stats[0])}

    return {
        "stages_ms": each(statistics.median, lambda stat: stat.stage_seconds),
        "stages_p95_ms": each(p95, lambda stat: stat.stage_seconds),
        "stages_core_ms": each(statistics.median, lambda stat: stat.stage_core_seconds),
    }


def _rates(stats: list[RenderStats], method: str, renderer: Renderer) -> dict[str, Any]:
    stage, unit = RATES[method]
    work = {"points": stats[-1].points, "blends": stats[-1].blends, "quads": stats[-1].splats_visible}[unit]

    def median_rate(times: Iterable[float]) -> float:
        return statistics.median(work / max(seconds, 1e-9) for seconds in times)

    core = None if renderer.device.is_cuda else median_rate(stat.stage_core_seconds[stage] for stat in stats)
    return {
        unit: work,
        "rate_per_second": median_rate(stat.stage_seconds[stage] for stat in stats),
        "rate_per_core_second": core,
    }


def _memory(renderer: Renderer, scene: Scene, settings: Settings) -> dict[str, Any]:
    counted = memory(renderer, scene, settings.storage)
    held = sum({id(i.cloud): i.cloud.splat_count for i in scene.instances}.values())
    return {
        "memory_bytes": {**counted, "process_peak": peak_process_bytes()},
        "bytes_per_splat": {name: counted[name] / held for name in ("splats", "groups", "working")},
    }


def culling_gain(
    renderer: Renderer, scene: Scene, camera: Camera, settings: Settings, repeats: int, row: dict[str, Any]
) -> dict[str, float]:
    """What occlusion culling leaves out of the splats in the frustum, and how much faster a frame is with it."""
    _, frames = timed_frames(renderer, scene, camera, replace(settings, culling="frustum"), repeats)
    in_frustum = frames[-1].stats.splats_visible
    core = 1e3 * statistics.median(frame.core for frame in frames)
    wall = 1e3 * statistics.median(frame.seconds for frame in frames)
    return {
        "splats_in_frustum": in_frustum,
        "culled_fraction": 1.0 - row["splats_visible"] / max(in_frustum, 1),
        "frame_ms_without": wall,
        "frame_core_ms_without": core,
        "speedup": wall / row["frame_ms"],
        "core_speedup": core / max(row["frame_core_ms"], 1e-9),
    }
