# SPDX-License-Identifier: GPL-3.0-or-later
"""`stipple info`: what is in a capture, for people and for programs."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from .formats import read_splats
from .splats import SplatCloud

PERCENTILES = (1, 25, 50, 75, 99)


def describe(path: Path) -> dict[str, Any]:
    """Facts about a capture as JSON values.

    `bounds` are of the means [object units]; `opacity` is activated (0 … 1); `scale` is each splat's largest
    standard deviation [object units]; percentiles are keyed "p1", "p25" …. Raises StippleError like the reader.
    """
    loaded = read_splats(path)
    cloud: SplatCloud = loaded.cloud
    low, high = cloud.bounds
    return {
        "file": str(path),
        "file_bytes": path.stat().st_size,
        "splats": cloud.splat_count,
        "dropped": int(loaded.dropped),
        "sh_degree": cloud.sh_degree,
        "host_bytes": cloud.nbytes,
        "bounds": {"min": low.tolist(), "max": high.tolist()},
        "opacity": _percentiles(cloud.opacity),
        "scale": _percentiles(cloud.scale.max(axis=1)),
        "warnings": list(loaded.warnings),
    }


def as_text(facts: dict[str, Any]) -> str:
    """The facts as aligned lines."""
    low, high = facts["bounds"]["min"], facts["bounds"]["max"]
    lines = {
        "splats": f"{facts['splats']:,} ({facts['dropped']:,} dropped)",
        "SH degree": str(facts["sh_degree"]),
        "file size": byte_size(facts["file_bytes"]),
        "in memory": byte_size(facts["host_bytes"]),
    }
    for axis, name in enumerate("xyz"):
        lines[f"bounds {name}"] = f"{low[axis]:.4g} … {high[axis]:.4g}"
    for name, note in (("opacity", ""), ("scale", " (largest axis)")):
        lines[name] = ", ".join(f"{key} {value:.3g}" for key, value in facts[name].items()) + note
    return "\n".join([facts["file"], *(f"  {name:<11}{text}" for name, text in lines.items())])


def as_json(facts: dict[str, Any]) -> str:
    """The facts as one JSON object."""
    return json.dumps(facts, indent=2, ensure_ascii=False)


def byte_size(count: float) -> str:
    """Bytes as a person reads them, in powers of 1000."""
    units = ("B", "kB", "MB", "GB", "TB")
    exponent = 0
    while count >= 1000 and exponent < len(units) - 1:
        count, exponent = count / 1000, exponent + 1
    return f"{count:.0f} {units[0]}" if exponent == 0 else f"{count:.3g} {units[exponent]}"


def _percentiles(values: npt.NDArray[np.float32]) -> dict[str, float]:
    return {f"p{p}": float(v) for p, v in zip(PERCENTILES, np.percentile(values, PERCENTILES), strict=True)}
