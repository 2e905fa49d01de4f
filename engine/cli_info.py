# SPDX-License-Identifier: GPL-3.0-or-later
"""`stipple info`: what is in a capture, for people and for programs."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from .formats import open_splats
from .formats.splat_source import Dropped
from .memory import byte_size
from .progress import Progress
from .splats import full_bytes_per_splat, packed_bytes_per_splat

PERCENTILES = (1, 25, 50, 75, 99)
SAMPLED_SPLATS = 1_000_000


def describe(path: Path, progress: Progress | None = None) -> dict[str, Any]:
    """Facts about a capture as JSON values, from one reading in chunks: a file may be larger than memory.

    `bounds` are of the means [object units]; `opacity` is activated (0 … 1); `scale` is each splat's largest
    standard deviation [object units]; percentiles are keyed "p1", "p25" … and of captures of more than a million
    splats taken from a million of them, at even steps. `host_bytes` are of the whole capture in memory,
    `device_bytes` of it quantised. Raises StippleError like the reader.
    """
    source, dropped = open_splats(path), Dropped()
    step, count = -(-source.splat_count // SAMPLED_SPLATS), 0
    low, high = np.full(3, np.inf), np.full(3, -np.inf)
    opacities, scales = [], []
    for chunk in source.chunks(("position", "scale", "opacity"), progress=progress, dropped=dropped):
        if chunk.splat_count:
            low = np.minimum(low, chunk.position.min(axis=0))
            high = np.maximum(high, chunk.position.max(axis=0))
            opacities.append(chunk.opacity[-count % step :: step].copy())
            scales.append(chunk.scale[-count % step :: step].max(axis=1))
            count += chunk.splat_count
    return {
        "file": str(path),
        "file_bytes": path.stat().st_size,
        "splats": count,
        "dropped": dropped.count,
        "sh_degree": source.sh_degree,
        "host_bytes": count * full_bytes_per_splat(source.sh_degree),
        "device_bytes": count * packed_bytes_per_splat(source.sh_degree),
        "bounds": {"min": low.tolist(), "max": high.tolist()},
        "opacity": _percentiles(np.concatenate(opacities)),
        "scale": _percentiles(np.concatenate(scales)),
        "warnings": list(dropped.warnings(path, source.splat_count)),
    }


def as_text(facts: dict[str, Any]) -> str:
    """The facts as aligned lines."""
    low, high = facts["bounds"]["min"], facts["bounds"]["max"]
    lines = {
        "splats": f"{facts['splats']:,} ({facts['dropped']:,} dropped)",
        "SH degree": str(facts["sh_degree"]),
        "file size": byte_size(facts["file_bytes"]),
        "in memory": f"{byte_size(facts['host_bytes'])}, quantised {byte_size(facts['device_bytes'])}",
    }
    for axis, name in enumerate("xyz"):
        lines[f"bounds {name}"] = f"{low[axis]:.4g} … {high[axis]:.4g}"
    for name, note in (("opacity", ""), ("scale", " (largest axis)")):
        lines[name] = ", ".join(f"{key} {value:.3g}" for key, value in facts[name].items()) + note
    return "\n".join([facts["file"], *(f"  {name:<11}{text}" for name, text in lines.items())])


def as_json(facts: dict[str, Any]) -> str:
    """The facts as one JSON object."""
    return json.dumps(facts, indent=2, ensure_ascii=False)


def _percentiles(values: npt.NDArray[np.float32]) -> dict[str, float]:
    return {f"p{p}": float(v) for p, v in zip(PERCENTILES, np.percentile(values, PERCENTILES), strict=True)}
