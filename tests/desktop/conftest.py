# SPDX-License-Identifier: GPL-3.0-or-later
"""Running scenarios and reading their screenshots."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from . import program


def run_scenario(script: str, scenario: str, folder: Path, *arguments: str) -> dict[str, Any]:
    """The results of a scenario of a script of this folder; skips where there is no desktop program."""
    try:
        return program.run(Path(__file__).with_name(script), scenario, folder, *arguments)
    except program.NotHere as reason:
        pytest.skip(str(reason))


def region_of(folder: Path, name: str, results: dict[str, Any]) -> np.ndarray:
    """The 3D view's pixels (H, W, 3) of a screenshot, without the edge where buttons are drawn."""
    pixels = np.asarray(Image.open(folder / f"{name}.png").convert("RGB")).astype(int)
    x, y, width, height = results[name]
    return pixels[len(pixels) - y - height : len(pixels) - y, x : x + width][70:-30, 40:-40]
