# SPDX-License-Identifier: GPL-3.0-or-later
"""Large splat files made on the spot, and what a process needed at most."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np

from stipple.engine.cache_places import CachePlaces
from stipple.engine.capture_file import CaptureFile
from stipple.engine.device import choose_device
from stipple.engine.device_cloud import DeviceCloud
from tests.engine.test_ply_files import splat_properties

BLOCK = 50_000


def row_bytes(rest_count: int) -> int:
    """Of a row with SH coefficients per channel above band 0 and without normals [bytes]."""
    return 4 * len(splat_properties(rest_count, normals=False))


def write_large(path: Path, count: int, rest_count: int, seed: int = 0) -> Path:
    """A little-endian 3DGS file of `count` splats in a ball of radius 3, about as large as a capture's; block by block.

    Blocks differ by a turn about z only, for drawing all random numbers anew takes longer than what is measured.
    """
    rng = np.random.default_rng(seed)
    names = list(splat_properties(rest_count, normals=False))
    block = rng.standard_normal((min(count, BLOCK), len(names)), np.float32)
    column = {name: index for index, name in enumerate(names)}
    block[:, [column[f"scale_{axis}"] for axis in range(3)]] = np.log(0.01) + 0.3 * block[:, :3]
    block[:, [column[name] for name in names if name.startswith("f_rest")]] *= 0.1
    header = f"ply\nformat binary_little_endian 1.0\nelement vertex {count}\n"
    header += "".join(f"property float {name}\n" for name in names) + "end_header\n"
    x, y = block[:, column["x"]].copy(), block[:, column["y"]].copy()
    with path.open("wb") as file:
        file.write(header.encode("ascii"))
        for first in range(0, count, BLOCK):
            angle = 0.7 * (first // BLOCK)
            block[:, column["x"]] = np.cos(angle) * x - np.sin(angle) * y
            block[:, column["y"]] = np.sin(angle) * x + np.cos(angle) * y
            file.write(block[: count - first].tobytes())
    return path


def run_python(program: str, *arguments: object, **variables: str) -> str:
    """What a program prints in a Python process of its own; fails with what it says where it fails."""
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)} | variables
    command = [sys.executable, "-c", program, *map(str, arguments)]
    result = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stderr
    return result.stdout


PLACES = CachePlaces(smallest_bytes=0)
GROUPS = ("low", "high", "sigma", "opacity", "packed_low", "packed_span", "packed_log_scale", "packed_brightest")


def cache_of(path: Path) -> Path:
    return path.with_name(path.name + ".stipple-cache")


def load(path: Path, device: str = "cpu", places: CachePlaces = PLACES) -> tuple[CaptureFile, DeviceCloud, set[str]]:
    """Opens and uploads a capture; also what the progress said."""
    capture, texts = CaptureFile.open(path, places), set()
    return capture, capture.upload(choose_device(device), lambda fraction, text: texts.add(text)), texts


def content(cloud: DeviceCloud) -> dict[str, Any]:
    """Every array and number of a cloud."""
    names = [name for name in dir(cloud) if not name.startswith("_") and name != "groups"]
    values = {name: getattr(cloud, name) for name in names}
    values |= {f"groups.{name}": getattr(cloud.groups, name) for name in (*GROUPS, "count", "shift")}
    return {name: v.numpy() if hasattr(v, "numpy") else v for name, v in values.items() if not callable(v)}


def assert_same(left: DeviceCloud, right: DeviceCloud) -> None:
    a, b = content(left), content(right)
    assert a.keys() == b.keys() and "packed_geometry" in a and a["packed_geometry"].size
    for name in a:
        assert np.array_equal(a[name], b[name]), name


def was_cached(texts: set[str]) -> bool:
    return texts == {"reading the cache of garden"}
