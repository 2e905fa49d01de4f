# SPDX-License-Identifier: GPL-3.0-or-later
"""What loading costs: at most 4 times `np.fromfile` of the same warm file, at most 1.5 times its size in memory.

Times are the least of many alternating runs: other work on the machine only ever adds to one, and unevenly to a reader
with two threads and a copy with one.
"""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from stipple.engine.formats import read_splats
from tests.engine.test_ply_files import splat_properties

REPEATS = 15
# Resident memory before, and the greatest until after, reading; a small file first loads what is lazily imported.
PEAK = """
import sys
from stipple.engine.formats import read_splats
def kibibytes(key):
    return next(int(line.split()[1]) for line in open("/proc/self/status") if line.startswith(key))
read_splats(sys.argv[1])
before = kibibytes("VmRSS")
loaded = read_splats(sys.argv[2])
print((kibibytes("VmHWM") - before) * 1024)
"""


def big_file(path: Path, count: int, rest_count: int) -> Path:
    rng = np.random.default_rng(0)
    names = splat_properties(rest_count, normals=rest_count > 0)
    header = f"ply\nformat binary_little_endian 1.0\nelement vertex {count}\n"
    header += "".join(f"property float {name}\n" for name in names) + "end_header\n"
    with path.open("wb") as file:
        file.write(header.encode("ascii"))
        rows = rng.standard_normal((min(count, 100_000), len(names)), np.float32)
        for first in range(0, count, len(rows)):
            file.write(rows[: count - first].tobytes())
    return path


def seconds(call: Callable[[], object]) -> float:
    start = time.perf_counter()
    result = call()
    duration = time.perf_counter() - start
    del result  # freeing is not reading
    return duration


@pytest.mark.slow
@pytest.mark.parametrize(("count", "rest_count"), [(1_000_000, 15), (2_000_000, 0)])
def test_time_and_peak_memory(tmp_path: Path, count: int, rest_count: int) -> None:
    path = big_file(tmp_path / "big.ply", count, rest_count)
    small = big_file(tmp_path / "small.ply", 1_000, rest_count)
    size = path.stat().st_size
    read_splats(small)
    np.fromfile(path, np.uint8)  # warm
    pairs = [(seconds(lambda: np.fromfile(path, np.uint8)), seconds(lambda: read_splats(path))) for _ in range(REPEATS)]
    plain, loading = (min(column) for column in zip(*pairs, strict=True))
    peak = peak_bytes(small, path) if Path("/proc/self/status").exists() else 0
    path.unlink()
    print(f"\n{size / 1e6:.0f} MB: fromfile {plain:.3f} s, load {loading:.3f} s, {loading / plain:.2f} times")
    print(f"peak {peak / size:.2f} times the file")
    assert loading <= 4 * plain
    assert peak <= 1.5 * size


def peak_bytes(small: Path, path: Path) -> int:
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)}
    command = [sys.executable, "-c", PEAK, str(small), str(path)]
    return int(subprocess.run(command, env=environment, capture_output=True, text=True, check=True).stdout)
