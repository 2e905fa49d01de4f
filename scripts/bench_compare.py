# SPDX-License-Identifier: GPL-3.0-or-later
"""This measurement against another one's JSON: ratios, where both measured the same thing."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

# Path in a row, and how the ratio is named in print.
COMPARED = {
    ("frame_ms",): "frame",
    ("frame_core_ms",): "frame, core",
    ("first_frame", "seconds"): "first frame",
    ("memory_bytes", "process_peak"): "peak memory",
    ("bytes_per_splat", "splats"): "bytes per splat",
    ("bytes_per_splat", "working"): "working bytes per splat",
    ("quality", "seconds"): "to 40 dB",
}
SAME = ("splats", "sh_degree", "made_from", "supersampling", "culling", "storage")


def comparison(result: dict[str, Any], other: dict[str, Any]) -> Iterator[str]:
    """Lines to print: below 1 is less time or memory than in `other`. Says where scenes or machines differ."""
    differing = [key for key, value in result["machine"].items() if other["machine"].get(key) != value]
    differing = [key for key in differing if key != "measured"]
    if differing:
        there = [f"{key} {other['machine'].get(key)}" for key in differing]
        yield f"the other machine: {', '.join(there)}"
    if result["size"] != other["size"]:
        yield f"not compared: this is {result['size']} px, the other {other['size']} px"
        return
    for preset, rows in result["presets"].items():
        for method, row in rows.items():
            before = other["presets"].get(preset, {}).get(method)
            if before is None:
                continue
            unlike = [key for key in SAME if row.get(key) != before.get(key)]
            if unlike:
                yield f"{preset:14} {method:7} not compared: another {', '.join(unlike)}"
                continue
            yield f"{preset:14} {method:7} " + "  ".join(_ratios(row, before))


def _ratios(row: dict[str, Any], before: dict[str, Any]) -> Iterator[str]:
    for path, name in COMPARED.items():
        new, old = _at(row, path), _at(before, path)
        if new is not None and old:
            yield f"{name} ×{new / old:.2f}"
    for stage, milliseconds in row["stages_ms"].items():
        old = before["stages_ms"].get(stage)
        if old and max(old, milliseconds) > 0.02 * row["frame_ms"]:
            yield f"{stage} ×{milliseconds / old:.2f}"


def _at(row: dict[str, Any], path: tuple[str, ...]) -> Any:
    value: Any = row
    for key in path:
        value = value.get(key) if isinstance(value, dict) else None
    return value
