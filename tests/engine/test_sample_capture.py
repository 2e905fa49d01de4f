# SPDX-License-Identifier: GPL-3.0-or-later
"""The sample capture: repeatable, valid, of the size asked for, the right way up, with highlights that move."""

from __future__ import annotations

import time

import numpy as np
import pytest

from stipple.engine.errors import StippleError
from stipple.engine.splats import ARRAY_NAMES, SH_C0, SplatCloud, degenerate_mask
from stipple.scripts.sample_capture import build_sample
from stipple.scripts.sample_capture.surfels import surface
from stipple.scripts.sample_capture.view_dependence import sh_basis

COUNT = 20_000


@pytest.fixture(scope="module")
def cloud() -> SplatCloud:
    return build_sample(COUNT, seed=3)


def test_equal_arguments_give_equal_arrays_quickly(cloud: SplatCloud) -> None:
    start = time.process_time()
    again = build_sample(COUNT, seed=3)
    assert time.process_time() - start < 5
    for name in ARRAY_NAMES:
        assert np.array_equal(getattr(cloud, name), getattr(again, name)), name


def test_another_seed_gives_another_capture(cloud: SplatCloud) -> None:
    other = build_sample(COUNT, seed=4)
    assert not np.array_equal(cloud.position, other.position)


def test_every_splat_is_valid(cloud: SplatCloud) -> None:
    sh = np.concatenate([cloud.sh_dc[:, None], cloud.sh_rest], axis=1)
    assert not degenerate_mask(cloud.position, cloud.scale, cloud.rotation, cloud.opacity, sh).any()
    np.testing.assert_allclose(np.linalg.norm(cloud.rotation, axis=1), 1, atol=1e-5)
    assert cloud.scale.min() > 0, "a scale of zero has no logarithm and could not be written to a PLY"
    assert cloud.opacity.min() > 0.5 and cloud.opacity.max() < 1
    assert cloud.sh_degree == 3


def test_the_count_is_the_requested_one(cloud: SplatCloud) -> None:
    assert cloud.splat_count == COUNT
    assert build_sample(33_333).splat_count == 33_333


def test_too_few_splats_are_refused_in_one_sentence() -> None:
    with pytest.raises(StippleError, match="at least 15000"):
        build_sample(14_999)


def test_it_stands_on_the_table_and_rises_along_minus_y(cloud: SplatCloud) -> None:
    low, high = cloud.bounds
    assert high[1] == pytest.approx(0, abs=0.05)  # few splats mean coarse ones: the moss hangs over
    assert -1.2 < low[1] < -0.8
    for axis in (0, 2):
        assert 2.1 < high[axis] - low[axis] < 2.6
        assert abs(high[axis] + low[axis]) < 0.2


def test_the_highest_things_are_red_and_much_of_the_floor_is_green(cloud: SplatCloud) -> None:
    """Guards the axes, the colour encoding and the composition at once."""
    colour = np.clip(0.5 + SH_C0 * cloud.sh_dc, 0, 1)
    height = -cloud.position[:, 1]
    cap = np.median(colour[height > 0.75], axis=0)
    assert cap[0] > 0.5 and cap[0] > 1.5 * max(cap[1:])
    floor = colour[(height > 0.13) & (height < 0.3)]
    assert (floor.argmax(axis=1) == 1).mean() > 0.3
    assert (floor.argmax(axis=1) == 2).mean() < 0.05


def test_splats_are_flat_and_face_outwards() -> None:
    """A sphere: the short axis of each splat is the normal, and the discs together cover about the area."""

    def sphere(u: np.ndarray, v: np.ndarray) -> np.ndarray:
        polar, angle = np.pi * u, 2 * np.pi * v
        return np.stack([np.sin(polar) * np.cos(angle), np.sin(polar) * np.sin(angle), np.cos(polar)], axis=1)

    made, _ = surface(sphere, 0.05, np.random.default_rng(0))
    assert len(made) == pytest.approx(4 * np.pi / 0.05**2, rel=0.05)
    inside = np.abs(made.position[:, 2]) < 0.99
    assert ((made.normal * made.position).sum(axis=1)[inside] > 0.99).all()
    spacing = np.sqrt(made.scale[:, 0] * made.scale[:, 1])[inside] / 0.05
    assert 0.5 < np.median(spacing) < 0.75
    assert (made.scale[:, 2] < 0.2 * made.scale[:, :2].min(axis=1)).all()


def test_highlights_move_with_the_view_and_colours_stay_in_range(cloud: SplatCloud) -> None:
    """From cameras around it, some splats change visibly; none leaves the range that a display can show by far."""
    sh = np.concatenate([cloud.sh_dc[:, None], cloud.sh_rest], axis=1)
    colours = []
    for azimuth in np.linspace(0, 2 * np.pi, 7):
        forward = np.array([[np.sin(azimuth), 0.4, np.cos(azimuth)]], np.float32)
        basis = sh_basis(forward / np.linalg.norm(forward))
        colours.append(0.5 + np.einsum("k,nkc->nc", basis[0], sh))
    change = np.ptp(np.stack(colours), axis=0).max(axis=1)
    assert (change > 0.08).mean() > 0.05
    assert np.quantile(np.stack(colours), 0.001) > -0.1
    assert np.quantile(np.stack(colours), 0.999) < 1.2
