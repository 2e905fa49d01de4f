# SPDX-License-Identifier: GPL-3.0-or-later
"""Quantised storage: what it takes, what it keeps, what cannot ruin it."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from scipy.spatial import cKDTree

from stipple.engine.device import choose_device
from stipple.engine.device_cloud import DeviceCloud, upload_cloud
from stipple.engine.errors import StippleError
from stipple.engine.group_bounds import bound_groups
from stipple.engine.quantise import quantise
from stipple.engine.splats import ARRAY_NAMES, SH_REST_COUNT, SplatCloud, packed_bytes_per_splat
from tests.device_clouds import boxes, covariance_of, read_back
from tests.scenes import cloud_of

PACKED = ("packed_geometry", "packed_opacity", "packed_colour", "packed_rest", "rest_largest", "sh_dc")
GROUPED = ("low", "high", "sigma", "opacity", "packed_low", "packed_span", "packed_log_scale", "packed_brightest")


def wide_cloud(count: int, seed: int, sh_degree: int = 0, anisotropy: float = 1e3) -> SplatCloud:
    """Splats of all shapes in a room, a quarter of them in one corner."""
    rng = np.random.default_rng(seed)
    position = rng.uniform(-5, 5, (count, 3))
    position[: count // 4] = rng.uniform(4.9, 5, (count // 4, 3))
    scale = 0.05 * np.exp(rng.uniform(-np.log(anisotropy), 0, (count, 3)))
    rest = rng.normal(0, 0.2, (count, SH_REST_COUNT[sh_degree], 3))
    return cloud_of(
        position, scale, rng.uniform(0.02, 1, count), rng.uniform(0, 1, (count, 3)), rng.normal(size=(count, 4)), rest
    )


def part_of(cloud: SplatCloud, begin: int, end: int) -> SplatCloud:
    return SplatCloud(*(np.ascontiguousarray(getattr(cloud, name)[begin:end]) for name in ARRAY_NAMES))


def packed(cloud: SplatCloud, device: Any, pieces: int = 1) -> DeviceCloud:
    cuts = np.linspace(0, cloud.splat_count, pieces + 1).astype(int)

    def chunks(_arrays: Collection[str]) -> Iterator[SplatCloud]:
        return (part_of(cloud, begin, end) for begin, end in pairwise(cuts))

    return quantise(chunks, cloud.splat_count, cloud.sh_degree, cloud.name, device)


@pytest.fixture(scope="module")
def warp_device(device: str) -> Any:
    return choose_device(device)


@pytest.mark.parametrize(("degree", "size"), [(0, 21), (1, 45), (2, 57), (3, 81), (4, 105)])
def test_bytes_per_splat_are_counted_from_the_arrays(warp_device: Any, degree: int, size: int) -> None:
    cloud = packed(wide_cloud(20_000, 1, degree), warp_device)
    held = sum(array.capacity for name in PACKED if (array := getattr(cloud, name)) is not None and array.size)
    assert held == size * cloud.splat_count == packed_bytes_per_splat(degree) * cloud.splat_count
    bounds = sum(getattr(cloud.groups, name).capacity for name in GROUPED)
    assert bounds <= 0.4 * cloud.splat_count
    assert cloud.splat_count - 20_000 < 256 * 3


@pytest.mark.parametrize("degree", [0, 3])
def test_every_splat_is_there_and_nearly_as_it_was(warp_device: Any, degree: int) -> None:
    cloud = wide_cloud(5_000, 2, degree)
    back = read_back(packed(cloud, warp_device), warp_device)
    distance, source = cKDTree(cloud.position).query(back.position)
    assert len(np.unique(source)) == cloud.splat_count
    assert distance.max() < 1e-6 * 10
    np.testing.assert_allclose(back.opacity, cloud.opacity[source], atol=0.5 / 255 + 1e-6)
    wanted = covariance_of(cloud.scale, cloud.rotation)[source]
    error = np.linalg.norm(back.covariance() - wanted, axis=(1, 2)) / np.linalg.norm(wanted, axis=(1, 2))
    assert error.max() < 0.02 and np.median(error) < 0.006
    if degree:
        np.testing.assert_array_equal(back.sh_dc, cloud.sh_dc[source])
        largest = np.abs(cloud.sh_rest[source]).max(axis=(1, 2), keepdims=True)
        assert (np.abs(back.sh_rest - cloud.sh_rest[source]) <= largest / 254 * 1.001).all()
    else:
        np.testing.assert_allclose(back.sh_dc, cloud.sh_dc[source], atol=0.5 / 1023 / 0.282 * 1.01)


def test_axes_turn_by_a_tenth_of_a_degree_at_most(warp_device: Any) -> None:
    """Seen on needles of 1 : 1000, whose long axis can be told from the covariance."""
    rng = np.random.default_rng(3)
    scale = np.tile([1.0, 1e-3, 1e-3], (20_000, 1))
    cloud = cloud_of(rng.uniform(-1, 1, (20_000, 3)), scale, 1.0, (0.5, 0.5, 0.5), rng.normal(size=(20_000, 4)))
    back = read_back(packed(cloud, warp_device), warp_device)
    _, source = cKDTree(cloud.position).query(back.position)
    axes = [np.linalg.eigh(c)[1][:, :, 2] for c in (back.covariance(), covariance_of(scale, cloud.rotation)[source])]
    sine = np.linalg.norm(np.cross(*axes), axis=1)
    assert np.degrees(np.arcsin(sine.max())) < 0.10


def test_a_disc_without_thickness_stays_one(warp_device: Any) -> None:
    scale = np.tile([0.1, 0.2, 0.0], (300, 1))
    cloud = cloud_of(np.random.default_rng(4).uniform(-1, 1, (300, 3)), scale, 1.0, (0.5, 0.5, 0.5))
    assert read_back(packed(cloud, warp_device), warp_device).scale.min(axis=1).max() < 1e-7


@pytest.mark.parametrize("what", ["position", "scale", "colour"])
def test_one_outlier_costs_the_others_nothing(warp_device: Any, what: str) -> None:
    cloud = wide_cloud(5_000, 5)
    position, scale, sh_dc = cloud.position.copy(), cloud.scale.copy(), cloud.sh_dc.copy()
    if what == "position":
        position[17] = 2e7
    elif what == "scale":
        scale[17] = 2e7
    else:
        sh_dc[17] = 2e7
    back = read_back(packed(replace(cloud, position=position, scale=scale, sh_dc=sh_dc), warp_device), warp_device)
    distance, source = cKDTree(position.astype(np.float64)).query(back.position.astype(np.float64))
    others = source != 17
    assert others.sum() == 4_999
    assert distance[others].max() < 1e-5
    if what == "position":
        assert distance[~others].max() <= 2  # half a step of a float there
    wanted = covariance_of(scale, cloud.rotation)[source]
    error = np.linalg.norm(back.covariance() - wanted, axis=(1, 2)) / np.linalg.norm(wanted, axis=(1, 2))
    assert error.max() < 0.03
    assert np.abs(back.sh_dc - sh_dc[source])[others].max() < 4 / 1023 / 0.282


@pytest.mark.parametrize("degree", [0, 2])
def test_how_a_file_is_cut_changes_no_bit(warp_device: Any, degree: int) -> None:
    cloud = wide_cloud(4_000, 6, degree)
    whole, pieces = (packed(cloud, warp_device, count) for count in (1, 7))
    for name in PACKED:
        a, b = getattr(whole, name), getattr(pieces, name)
        assert (a is None) == (b is None)
        if a is not None:
            np.testing.assert_array_equal(a.numpy(), b.numpy())


def test_neighbours_in_the_order_are_neighbours_in_space(warp_device: Any) -> None:
    cloud = wide_cloud(50_000, 7)
    groups = packed(cloud, warp_device).groups
    size = (groups.high.numpy() - groups.low.numpy())[groups.opacity.numpy() > 0]
    whole = cloud.position.max(axis=0) - cloud.position.min(axis=0)
    assert np.median(size.prod(axis=1)) < 0.02 * whole.prod()


@pytest.mark.parametrize("stored", ["full", "quantised"])
def test_boxes_hold_the_truncated_splats(warp_device: Any, stored: str) -> None:
    cloud = wide_cloud(5_000, 8)
    held = packed(cloud, warp_device) if stored == "quantised" else upload_cloud(cloud, warp_device)
    if stored == "full":
        bound_groups(held, warp_device)
    alpha_min = 1 / 255
    back = read_back(held, warp_device)
    low, high = (
        corner[back.place >> held.groups.shift].astype(np.float64) for corner in boxes(held, alpha_min, warp_device)
    )
    reach = np.sqrt(2 * np.maximum(np.log(back.opacity.astype(np.float64) / alpha_min), 0))
    half = reach[:, None] * np.sqrt(np.diagonal(back.covariance(), axis1=1, axis2=2))
    assert (back.position - half >= low).all() and (back.position + half <= high).all()
    assert (high - low).max() < 11  # and not just anything


def test_a_file_that_changes_between_readings_is_refused(warp_device: Any) -> None:
    cloud = wide_cloud(1_000, 9)
    shorter = part_of(cloud, 0, 900)
    readings = iter([[cloud], [shorter]])
    with pytest.raises(StippleError, match=r"900 splats, 1,000 at first"):
        quantise(lambda _arrays: next(readings), 1_000, 0, "changing", warp_device)
