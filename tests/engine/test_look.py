# SPDX-License-Identifier: GPL-3.0-or-later
"""Looks as plain values: what they refuse, when they are equal, how gradings compose."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from stipple.engine.colour import WORKING_SPACES
from stipple.engine.errors import StippleError
from stipple.engine.look import MOST_CROPS, Crop, Look, crop_from_object
from tests.oracle.look import LUMINANCE


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"display": "cubes"}, "display is 'cubes'; choose one of splats, points, ellipsoids"),
        ({"exposure": float("nan")}, "exposure is nan; give a value from -32.0 to 32.0"),
        ({"gain": (1.0, -0.1, 1.0)}, "gain is -0.1; give a value from 0.0"),
        ({"saturation": -1.0}, "saturation is -1.0"),
        ({"tint_factor": 1.5}, "tint_factor is 1.5"),
        ({"opacity": float("inf")}, "opacity is inf"),
        ({"size": -1.0}, "size is -1.0"),
        ({"point_px": 0.0}, "point_px is 0.0"),
        ({"sh_degree": 5}, "sh_degree is 5; give 0 to 4"),
        ({"crops": (Crop(),) * (MOST_CROPS + 1)}, "there are 9 crops on one object; it can have 8"),
    ],
)
def test_values_out_of_range_are_refused(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(StippleError, match=message):
        Look(**changes)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"shape": "cone"}, "shape is 'cone'; choose one of box, sphere"),
        ({"keep": "both"}, "keep is 'both'; choose one of inside, outside"),
        ({"world_from_crop": ((1.0, 0.0, 0.0),) * 3}, "give three rows of four"),
    ],
)
def test_crops_out_of_range_are_refused(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(StippleError, match=message):
        Crop(**changes)


def test_equal_looks_are_equal() -> None:
    """Hosts compare scenes by value to see whether anything changed."""
    looks = [Look(gain=(1.0, 2.0, 1.0), crops=(Crop(shape="sphere"),)) for _ in range(2)]
    assert looks[0] == looks[1] and hash(looks[0]) == hash(looks[1])
    assert looks[0] != Look(gain=(1.0, 2.0, 1.0), crops=(Crop(),))


def test_colours_do_not_decide_what_is_seen() -> None:
    assert Look(gain=(0.1, 1.0, 1.0), exposure=3.0, saturation=0.0, tint_factor=1.0).visibility == Look().visibility
    for changes in ({"opacity": 0.5}, {"size": 2.0}, {"crops": (Crop(),)}, {"display": "points"}, {"point_px": 9.0}):
        assert Look(**changes).visibility != Look().visibility  # type: ignore[arg-type]


@pytest.mark.parametrize("space", WORKING_SPACES)
def test_gradings_that_change_nothing_and_that_leave_grey_grey(space: str) -> None:
    assert Look(working_space=space, tint=(0.2, 0.9, 0.1)).light_matrix() is None
    saturated = Look(working_space=space, saturation=1.7).light_matrix()
    assert saturated is not None
    np.testing.assert_allclose(saturated @ np.ones(3), 1.0, atol=1e-9)
    exposed = Look(working_space=space, exposure=2.0).light_matrix()
    assert exposed is not None
    np.testing.assert_allclose(exposed, 4 * np.eye(3), atol=1e-9)


def test_a_tint_keeps_the_luminance() -> None:
    tinted = Look(tint=(0.1, 0.4, 0.9), tint_factor=0.7).light_matrix()
    assert tinted is not None
    np.testing.assert_allclose(LUMINANCE @ tinted, LUMINANCE, atol=1e-4)  # the engine's follow from the primaries


def test_crops_are_composed_where_they_are_and_not_at_the_origin() -> None:
    """A crop of one unit, ten million units away: single precision knows no such place."""
    away = np.array([1e7, -3e7, 2e7])
    crop = Crop(tuple(map(tuple, np.column_stack([np.eye(3), away + np.array([0.5, 0.0, 0.0])]).tolist())))
    np.testing.assert_allclose(
        crop_from_object(crop, np.column_stack([np.eye(3), away]))[:, 3], [-0.5, 0, 0], atol=1e-8
    )
    flat = Crop(((1.0, 0, 0, 0), (0, 1.0, 0, 0), (0, 0, 0, 0)))
    assert np.isnan(crop_from_object(flat, np.eye(3, 4))).all()


def test_a_look_needs_no_device(root: Path) -> None:
    """Blender reads looks before anything is rendered, and Warp must not start for that."""
    program = "import sys, stipple.engine.look, stipple.engine.scene; sys.exit('warp' in sys.modules)"
    subprocess.run([sys.executable, "-c", program], cwd=root, check=True)
