# SPDX-License-Identifier: GPL-3.0-or-later
"""Results for the terminal."""

from __future__ import annotations

from typing import Any

from stipple.scripts.bench_rays import HALVES
from stipple.scripts.bench_rows import RATES


def print_row(preset: str, method: str, row: dict[str, Any]) -> None:
    _, unit = RATES[method]
    per_core = row["rate_per_core_second"]
    core = f" ({row['frame_core_ms']:.1f} core ms)" if per_core else ""
    print(
        f"{preset:14} {method:7} {row['frame_ms']:8.1f} ms{core}, p95 {row['frame_p95_ms']:.1f}  "
        f"{row[unit] / 1e6:.1f} M {unit}  {row['rate_per_second'] / 1e6:.3g} M/s"
        f"{f'  {per_core / 1e6:.3g} M/s per core' if per_core else ''}"
    )
    stages = "  ".join(f"{name} {ms:.1f}" for name, ms in row["stages_ms"].items())
    each, total, first = row["bytes_per_splat"], row["memory_bytes"], row["first_frame"]
    lines = [
        stages,
        f"bytes per splat {each['splats']:.1f}, groups {each['groups']:.2f}, working {each['working']:.2f}; "
        f"picture {total['picture'] / 2**20:.0f} MiB; peak of the process {total['process_peak'] / 2**30:.2f} GiB",
        f"first frame {first['seconds']:.2f} s ({first['core_seconds']:.2f} core s): "
        f"open {first['open_seconds']:.2f}, upload {first['upload_seconds']:.2f}",
    ]
    if gain := row.get("culling_gain"):
        lines.append(
            f"occlusion culling leaves out {gain['culled_fraction']:.1%} of {gain['splats_in_frustum'] / 1e6:.2f} M "
            f"splats in the frustum; ×{gain['speedup']:.2f} faster (core ×{gain['core_speedup']:.2f})"
        )
    if quality := row.get("quality"):
        lines.append(
            f"{quality['reached_db']:.1f} dB after {quality['samples']} samples, {quality['seconds']:.1f} s "
            f"({quality['core_seconds']:.1f} core s)"
        )
    lines += [_half(half, row) for half in HALVES if "vertex_ms" in row]
    for line in lines:
        print(f"{'':22} {line}")


def _half(half: str, row: dict[str, Any]) -> str:
    """The vertex or the fill work of rays."""
    per_core = row[f"{half}_splats_per_core_second"]
    return (
        f"{half} {row[f'{half}_ms']:.1f} ms  {row[f'{half}_splats_per_second'] / 1e6:.3g} M splats/s"
        f"{f'  {per_core / 1e6:.3g} M/s per core' if per_core else ''}  on {row['graphics']}"
    )


def print_path(preset: str, path: dict[str, Any]) -> None:
    print(f"{preset:14} {'t':>5} {'splats':>12} {'ms':>9} {'core ms':>9}   without culling")
    for index, t in enumerate(path["t"]):
        columns = [
            f"{path[culling]['splats'][index]:12,} {path[culling]['frame_ms'][index]:9.1f} "
            f"{path[culling]['frame_core_ms'][index]:9.1f}"
            for culling in ("occlusion", "frustum")
            if culling in path
        ]
        print(f"{'':14} {t:5.2f} " + "   ".join(columns))
