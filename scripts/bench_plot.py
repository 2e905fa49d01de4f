# SPDX-License-Identifier: GPL-3.0-or-later
"""Frame times along camera paths as an SVG, drawn by hand: a plotting library would be a hundred times this file."""

from __future__ import annotations

from typing import Any

import numpy as np

WIDTH, HEIGHT, LEFT, BOTTOM, TOP, RIGHT = 720, 420, 70, 50, 30, 130
COLOURS = ("#0b6e99", "#c8553d", "#4c8c4a", "#8e5ea2", "#b8860b", "#555555", "#d17bb0")
INK = "#333333"


def plot_paths(paths: dict[str, dict[str, Any]], unit: str) -> str:
    """An SVG; per preset a solid line with occlusion culling and a dashed one without.

    `unit` is "frame_ms" or "frame_core_ms", [ms] on a logarithmic axis.
    """
    lines = []  # name, colour, dashed, t, values
    for index, (name, path) in enumerate(paths.items()):
        colour = COLOURS[index % len(COLOURS)]
        for culling, dashed in (("occlusion", False), ("frustum", True)):
            if culling in path:
                lines.append((name, colour, dashed, path["t"], path[culling][unit]))
    values = np.concatenate([line[4] for line in lines])
    low, high = 10 ** np.floor(np.log10(values.min())), 10 ** np.ceil(np.log10(values.max()))

    def place(t: float, value: float) -> tuple[float, float]:
        share = np.log10(value / low) / np.log10(high / low)
        return LEFT + t * (WIDTH - LEFT - RIGHT), HEIGHT - BOTTOM - share * (HEIGHT - BOTTOM - TOP)

    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {HEIGHT}" font-family="sans-serif" '
        f'font-size="13" fill="{INK}">',
        f'<rect width="{WIDTH}" height="{HEIGHT}" fill="white"/>',
        *_axes(float(low), float(high), place, unit),
    ]
    for name, colour, dashed, times, measured in lines:
        points = [place(t, value) for t, value in zip(times, measured, strict=True)]
        joined = " ".join(f"{x:.1f},{y:.1f}" for x, y in points)
        dash = ' stroke-dasharray="5 4"' if dashed else ""
        parts.append(f'<polyline points="{joined}" fill="none" stroke="{colour}" stroke-width="2"{dash}/>')
        if not dashed:
            x, y = points[-1]
            parts.append(f'<text x="{x + 8:.1f}" y="{y + 4:.1f}" fill="{colour}">{name}</text>')
    return "\n".join([*parts, "</svg>"]) + "\n"


def _axes(low: float, high: float, place: Any, unit: str) -> list[str]:
    """Grid lines at 1, 2 and 5 of each decade, and what the axes mean."""
    parts = []
    right = place(1.0, low)[0]
    for decade in range(round(np.log10(low)), round(np.log10(high)) + 1):
        for digit in (1, 2, 5):
            value = digit * 10.0**decade
            if value <= high * 1.001:
                y = place(0.0, value)[1]
                parts.append(f'<line x1="{LEFT}" y1="{y:.1f}" x2="{right:.1f}" y2="{y:.1f}" stroke="#dddddd"/>')
                parts.append(f'<text x="{LEFT - 8}" y="{y + 4:.1f}" text-anchor="end">{value:g}</text>')
    what = "core ms per frame" if unit == "frame_core_ms" else "ms per frame"
    middle = (LEFT + right) / 2
    y = HEIGHT - 18
    parts.append(f'<text x="{LEFT}" y="{y}">close</text><text x="{right:.1f}" y="{y}" text-anchor="end">far</text>')
    parts.append(f'<text x="{middle:.1f}" y="{y}" text-anchor="middle">along the camera path</text>')
    parts.append(f'<text x="{LEFT}" y="18">{what}; dashed: without occlusion culling</text>')
    return parts
