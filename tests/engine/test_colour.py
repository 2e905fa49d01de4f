# SPDX-License-Identifier: GPL-3.0-or-later
"""Colour: published values, round trips, and premultiplication where there is nothing to divide by."""

from __future__ import annotations

import numpy as np
import pytest

from stipple.engine.colour import (
    WORKING_SPACES,
    bytes_from_display,
    display_from_bytes,
    display_from_scene_linear,
    linear_from_srgb,
    scene_linear_from_display,
    srgb_from_linear,
    working_space_from_rec709,
    xyz_from_rgb,
)
from stipple.engine.errors import StippleError


@pytest.mark.parametrize(
    ("encoded", "linear"),
    [(0.0, 0.0), (1.0, 1.0), (0.5, 0.21404114048223255), (0.02, 0.02 / 12.92), (0.04045, 0.04045 / 12.92)],
)
def test_transfer_function_has_the_standards_values(encoded: float, linear: float) -> None:
    assert linear_from_srgb(np.array([encoded]))[0] == pytest.approx(linear, abs=1e-12)
    assert srgb_from_linear(np.array([linear]))[0] == pytest.approx(encoded, abs=1e-7)


def test_transfer_functions_are_inverse_beyond_the_unit_range() -> None:
    values = np.concatenate([np.linspace(-3, 12, 3001), [0.04045, 0.0404500001, -0.04045]])
    # At the knee itself the standard's rounded constants leave a step of 3e-8.
    np.testing.assert_allclose(srgb_from_linear(linear_from_srgb(values)), values, atol=1e-7)
    np.testing.assert_allclose(linear_from_srgb(srgb_from_linear(values)), values, atol=1e-7)
    assert linear_from_srgb(np.array([2.0]))[0] > linear_from_srgb(np.array([1.0]))[0]
    np.testing.assert_array_equal(linear_from_srgb(-values), -linear_from_srgb(values))


def test_linearising_sees_the_straight_colour() -> None:
    straight, alpha = np.array([0.5, 0.25, 1.5]), 0.3
    rgba = np.array([[[*(straight * alpha), alpha]]], dtype=np.float32)
    linear = scene_linear_from_display(rgba)
    assert linear.dtype == np.float32
    np.testing.assert_allclose(linear[0, 0], [*(linear_from_srgb(straight) * alpha), alpha], rtol=1e-6)
    assert not np.allclose(linear[0, 0, :3], linear_from_srgb(straight * alpha), rtol=0.1)


@pytest.mark.parametrize("working_space", WORKING_SPACES)
def test_scene_linear_round_trip(working_space: str) -> None:
    rng = np.random.default_rng(5)
    alpha = rng.uniform(1e-3, 1.0, (40, 50, 1))
    rgba = np.concatenate([rng.uniform(0.0, 1.6, (40, 50, 3)) * alpha, alpha], axis=-1).astype(np.float32)
    back = display_from_scene_linear(scene_linear_from_display(rgba, working_space), working_space)
    np.testing.assert_allclose(back, rgba, atol=3e-6)


def test_no_coverage_is_black_and_finite() -> None:
    rgba = np.array([[0, 0, 0, 0], [1e-30, 0, 0, 1e-38], [0.2, 0.2, 0.2, 0.2]], dtype=np.float32)
    with np.errstate(all="raise"):
        linear, pixels = scene_linear_from_display(rgba), bytes_from_display(rgba)
    np.testing.assert_array_equal(linear[:2, :3], 0)
    np.testing.assert_array_equal(pixels, [[0, 0, 0, 0], [0, 0, 0, 0], [255, 255, 255, 51]])


def test_every_8_bit_colour_survives_at_every_coverage() -> None:
    colour, alpha = np.meshgrid(np.arange(256, dtype=np.uint8), np.arange(1, 256, dtype=np.uint8))
    pixels = np.stack([colour, colour[:, ::-1], colour, alpha], axis=-1)
    np.testing.assert_array_equal(bytes_from_display(display_from_bytes(pixels)), pixels)


def test_8_bit_rounds_to_the_nearest_level() -> None:
    values = np.array([0.49, 0.51, 1.49, 1.51, 254.49, 254.51, 300.0, -4.0], dtype=np.float32) / 255
    rgba = np.stack([values, values, values, np.ones_like(values)], axis=-1)
    assert bytes_from_display(rgba)[:, 0].tolist() == [0, 1, 1, 2, 254, 255, 255, 0]


def test_matrices_have_the_published_values() -> None:
    """BT.2087-0 table for Rec.2020; OpenColorIO's ACES configuration (Bradford) for ACEScg."""
    rec2020 = [[0.6274, 0.3293, 0.0433], [0.0691, 0.9195, 0.0114], [0.0164, 0.0880, 0.8956]]
    acescg = [[0.613097, 0.339523, 0.047380], [0.070194, 0.916354, 0.013452], [0.020616, 0.109570, 0.869815]]
    np.testing.assert_allclose(working_space_from_rec709("Rec.2020"), rec2020, atol=5e-5)
    np.testing.assert_allclose(working_space_from_rec709("ACEScg"), acescg, atol=1e-6)
    np.testing.assert_allclose(working_space_from_rec709("Rec.709"), np.eye(3), atol=1e-14)
    luminance = xyz_from_rgb(WORKING_SPACES["Rec.709"])[1]
    np.testing.assert_allclose(luminance, [0.2126, 0.7152, 0.0722], atol=5e-5)


@pytest.mark.parametrize("working_space", WORKING_SPACES)
def test_white_stays_white(working_space: str) -> None:
    white = np.ones((1, 4), dtype=np.float32)
    np.testing.assert_allclose(scene_linear_from_display(white, working_space), white, atol=1e-6)


def test_unknown_working_space_is_named() -> None:
    with pytest.raises(StippleError, match=r"'P3'; choose one of Rec\.709, Rec\.2020, ACEScg"):
        scene_linear_from_display(np.ones((1, 4), dtype=np.float32), "P3")
