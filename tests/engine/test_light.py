# SPDX-License-Identifier: GPL-3.0-or-later
"""The fast conversion to light against the reference in float64."""

from __future__ import annotations

import numpy as np
import pytest

from stipple.engine.colour import WORKING_SPACES, scene_linear_from_display
from stipple.engine.errors import StippleError
from tests.light import light_of


def picture(height: int, width: int) -> np.ndarray:
    """Colours from far below the curve's knee to far above 1, some negative, under every coverage."""
    rng = np.random.default_rng(height * width)
    straight = np.exp(rng.uniform(np.log(1e-6), np.log(1e4), (height, width, 4)))
    straight[rng.uniform(size=straight.shape) < 0.1] *= -1
    alpha = rng.choice([0.0, 1e-12, 1e-3, 0.5, 1.0], (height, width, 1))
    return np.concatenate([straight[..., :3] * alpha, alpha], axis=2).astype(np.float32)


@pytest.mark.parametrize("space", WORKING_SPACES)
@pytest.mark.parametrize("size", [(1, 1), (3, 21), (37, 130), (64, 300)])
def test_it_equals_the_reference(space: str, size: tuple[int, int], device: str) -> None:
    rgba = picture(*size)
    wanted = scene_linear_from_display(rgba.astype(np.float64), space)[::-1]
    light = light_of(rgba, space, device)
    largest = np.abs(wanted[..., :3]).max(axis=2, keepdims=True)  # a matrix may cancel one channel against another
    assert (np.abs(light - wanted)[..., :3] <= 2e-6 * largest).all()
    np.testing.assert_array_equal(light[..., 3], rgba[::-1, :, 3])


def test_black_white_and_nothing_are_exact() -> None:
    rgba = np.array([[[0, 0, 0, 1], [1, 1, 1, 1], [0, 0, 0, 0]]], np.float32)
    np.testing.assert_allclose(light_of(rgba), rgba, atol=1e-7)


def test_an_unknown_working_space_is_refused() -> None:
    with pytest.raises(StippleError, match="working space"):
        light_of(picture(2, 2), "Rec.601")
