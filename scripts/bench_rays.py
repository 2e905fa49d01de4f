# SPDX-License-Identifier: GPL-3.0-or-later
"""Vertex and fill work of *rays*, told apart."""

from __future__ import annotations

import time
from dataclasses import replace
from typing import Any

import numpy as np

from stipple.engine.camera import Camera
from stipple.engine.rays.host import Draw
from stipple.engine.renderer import Frame, Renderer
from stipple.engine.scene import Scene
from stipple.engine.settings import Settings

HALVES = ("vertex", "fill")  # of a draw of rays
SOFTWARE_DRIVER = "llvmpipe"  # draws on the processor's cores


def vertex_and_fill(
    renderer: Renderer, scene: Scene, camera: Camera, settings: Settings, repeats: int
) -> dict[str, Any]:
    """Milliseconds and splats per second of the two halves of a draw of *rays*, by the clock and by core seconds.

    Three draws in turn, medians of each: of nothing (clearing and reading back), of all quads moved out of the
    picture, which does the vertex work and fills no pixel, and of the picture. Their differences are the halves.
    """
    frame = Frame(renderer, scene, camera, settings)
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
    result: dict[str, Any] = {"graphics": host.name}  # type: ignore[attr-defined]
    halves = np.median(np.diff(np.array(times[1:]), axis=1), axis=0).tolist()
    for name, (seconds, core_seconds) in zip(HALVES, halves, strict=True):
        result[f"{name}_ms"] = 1e3 * seconds
        result[f"{name}_splats_per_second"] = picture.splat_count / seconds
        on_cores = SOFTWARE_DRIVER in result["graphics"]
        result[f"{name}_splats_per_core_second"] = picture.splat_count / core_seconds if on_cores else None
    return result
