# SPDX-License-Identifier: GPL-3.0-or-later
"""Frame times along a preset's camera path, with and without occlusion culling (Fig. 8 of doi 10.1145/3811272)."""

from __future__ import annotations

import statistics
from dataclasses import replace
from typing import Any

from stipple.engine.renderer import Renderer
from stipple.engine.settings import Settings
from stipple.scripts.bench_presets import Opened
from stipple.scripts.bench_rows import Timed, timed_frame


def measure_path(
    renderer: Renderer, opened: Opened, size: tuple[int, int], settings: Settings, steps: int, runs: int
) -> dict[str, Any]:
    """Medians over `runs` passes of `steps` frames each, one sample a frame; culling remembers the frame before."""
    times = [step / max(steps - 1, 1) for step in range(steps)]
    cameras = [opened.path.camera(t, size) for t in times]
    result: dict[str, Any] = {"t": times, "size": list(size), "runs": runs}
    for culling in ("occlusion", "frustum") if settings.method == "points" else (settings.culling,):
        asked = replace(settings, culling=culling)
        timed_frame(renderer, opened.scene, cameras[0], asked)
        passes = [[timed_frame(renderer, opened.scene, camera, asked) for camera in cameras] for _ in range(runs)]
        result[culling] = _summary([list(frames) for frames in zip(*passes, strict=True)])
    return result


def _summary(frames: list[list[Timed]]) -> dict[str, list[float]]:
    """Per step, over the passes."""
    return {
        "frame_ms": [1e3 * statistics.median(frame.seconds for frame in step) for step in frames],
        "frame_core_ms": [1e3 * statistics.median(frame.core for frame in step) for step in frames],
        "splats": [step[-1].stats.splats_visible for step in frames],
        "points": [step[-1].stats.points for step in frames],
    }
