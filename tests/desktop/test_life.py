# SPDX-License-Identifier: GPL-3.0-or-later
"""The viewport in a real Blender window through edits, sizes and first use, and captures in Solid shading."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from .conftest import region_of, run_scenario

pytestmark = [pytest.mark.slow, pytest.mark.blender]
SCRIPT = "scenarios_life.py"


def red(pixels: np.ndarray) -> np.ndarray:
    return (pixels[..., 0] > 100) & (pixels[..., 0] - pixels[..., 1] > 60) & (pixels[..., 0] - pixels[..., 2] > 60)


def test_first_use_says_what_it_does_and_never_freezes(tmp_path: Path) -> None:
    """The profile is new, so that the kernels are compiled."""
    results = run_scenario(SCRIPT, "first_use", tmp_path)
    counting = [text for text in results["messages"] if "slow only the first time" in text]
    assert len(counting) >= 5, results["messages"]
    assert results["seconds"] > 2 * results["longest_gap"], results
    assert results["longest_gap"] < 1.0, results


def test_edits_show_at_once_and_read_only_what_changed(tmp_path: Path) -> None:
    results = run_scenario(SCRIPT, "edits", tmp_path)
    pixels = {name: values[0] for name, values in results.items()}
    splats = {name: values[1] for name, values in results.items()}
    reads = {name: values[2] for name, values in results.items()}
    assert pixels["start"] > 5000 and pixels["moved"] > 3000
    assert pixels["scaled"] < 0.5 * pixels["moved"] and pixels["undone"] == pixels["start"]
    assert pixels["hidden"] == splats["hidden"] == 0 and pixels["shown"] == pixels["start"]
    assert splats["local view of another"] == 0 and pixels["local view left"] == pixels["start"]
    assert splats["type hidden"] == 0 and pixels["type shown"] == pixels["start"]
    assert splats["frame 2"] == 0 and pixels["frame 1"] == pixels["start"]
    assert pixels["edited"] < 0.1 * pixels["start"]
    again = {name for name, count in reads.items() if count}
    # An undo and what was taken from the scene are compared by content; nothing else looks at unchanged data again.
    assert again == {"undone", "shown", "frame 2", "edited"}, reads  # animation data: Blender evaluates anew


def test_two_views_render_resize_without_black_and_rest(tmp_path: Path) -> None:
    results = run_scenario(SCRIPT, "views", tmp_path)
    for name in ("view 0", "view 1", "full", "back"):
        pixels = region_of(tmp_path, name, results)
        assert red(pixels).sum() > 1000, name
        assert (pixels.max(axis=2) > 40).mean() > 0.999, name  # the world is blue
    assert results["idle"]["redraws"] == 0
    assert results["idle"]["cores"] < 0.1


def test_solid_shading_shows_colours_to_place_a_capture_by(tmp_path: Path) -> None:
    results = run_scenario(SCRIPT, "solid", tmp_path)
    seen = {name: red(region_of(tmp_path, name, results)).sum() for name, at in results.items() if is_region(at)}
    gray = region_of(tmp_path, "gray", results)
    shape = gray.max(axis=2) > 30
    assert shape.sum() > 5000
    colours = region_of(tmp_path, "colours", results)
    assert red(colours)[shape].mean() > 0.98 and seen["gray"] == 0
    # sRGB 0.5 ± 0.282 · 1.7: the capture's own color, as no light changes it
    assert np.abs(np.median(colours[red(colours)], axis=0) - [250, 5, 5]).max() <= 1
    assert seen["hidden"] == 0 and seen["inside a cube"] == 0
    assert seen["in front"] > 0.95 * seen["colours"]
    assert 1.1 * seen["colours"] < seen["twice"]
    assert 0.8 * seen["colours"] < seen["mesh"] < 1.2 * seen["colours"]
    near = region_of(tmp_path, "selected", results)  # at angles of up to 35°, too, no gray shows between the colours
    assert (near.min(axis=2) > 150).mean() < 0.001 and red(near).mean() > 0.3
    assert results["clicked"] == [True, False] and results["clicked again"]
    assert np.allclose(results["framed"][:3], 0, atol=0.05) and 3 < results["framed"][3] < 15


def is_region(value: Any) -> bool:
    return isinstance(value, list) and len(value) == 4 and all(isinstance(number, int) for number in value)
