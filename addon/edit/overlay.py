# SPDX-License-Identifier: GPL-3.0-or-later
"""Lines and circles over the viewport while a gesture or stroke lasts."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import bpy

WHITE = (1.0, 1.0, 1.0, 0.9)
BLACK = (0.0, 0.0, 0.0, 0.6)
Point = tuple[float, float]


class Overlay:
    """Draws in one region until `end`; `draw` is called with each redraw of it."""

    def __init__(self, context: Any, draw: Callable[[], None]) -> None:
        b_region = context.region

        def here() -> None:
            if bpy.context.region == b_region:
                draw()

        self._handle: Any = bpy.types.SpaceView3D.draw_handler_add(here, (), "WINDOW", "POST_PIXEL")

    def end(self) -> None:
        if self._handle is not None:
            bpy.types.SpaceView3D.draw_handler_remove(self._handle, "WINDOW")
            self._handle = None


def draw_lines(points: Sequence[Point], closed: bool = True) -> None:
    """A line through pixels of the region, white with a dark rim."""
    import gpu
    from gpu_extras.batch import batch_for_shader

    if len(points) < 2:
        return
    path = [*points, points[0]] if closed else list(points)
    shader = gpu.shader.from_builtin("UNIFORM_COLOR")
    gpu.state.blend_set("ALPHA")
    for width, colour in ((3.0, BLACK), (1.0, WHITE)):
        gpu.state.line_width_set(width)
        shader.uniform_float("color", colour)
        batch_for_shader(shader, "LINE_STRIP", {"pos": [(x, y, 0.0) for x, y in path]}).draw(shader)
    gpu.state.line_width_set(1.0)
    gpu.state.blend_set("NONE")


def draw_circle(centre: Point, radius: float, inner: float | None = None) -> None:
    """A brush: its rim, and inside it the part that has full effect."""
    from gpu_extras.presets import draw_circle_2d

    draw_circle_2d(centre, BLACK, radius + 1, segments=64)
    draw_circle_2d(centre, WHITE, radius, segments=64)
    if inner:
        draw_circle_2d(centre, (1.0, 1.0, 1.0, 0.35), radius * inner, segments=48)
