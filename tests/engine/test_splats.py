# SPDX-License-Identifier: GPL-3.0-or-later
"""SplatCloud refuses arrays the engine could not use; `degenerate_mask` finds what cannot be rendered."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from stipple.engine.errors import StippleError
from stipple.engine.splats import SplatCloud, degenerate_mask, sh_degree_of_rest_count


def arrays(count: int = 4, rest_count: int = 3) -> dict[str, np.ndarray]:
    return {
        "position": np.arange(3 * count, dtype=np.float32).reshape(count, 3),
        "scale": np.full((count, 3), 0.1, np.float32),
        "rotation": np.tile(np.float32([1, 0, 0, 0]), (count, 1)),
        "opacity": np.full(count, 0.5, np.float32),
        "sh_dc": np.zeros((count, 3), np.float32),
        "sh_rest": np.zeros((count, rest_count, 3), np.float32),
    }


@pytest.mark.parametrize(("rest_count", "degree"), [(0, 0), (3, 1), (8, 2), (15, 3), (24, 4)])
def test_what_a_cloud_says_of_itself(rest_count: int, degree: int) -> None:
    cloud = SplatCloud(**arrays(4, rest_count), name="tree")
    assert (cloud.splat_count, cloud.sh_degree, cloud.name) == (4, degree, "tree")
    assert sh_degree_of_rest_count(rest_count) == degree
    assert cloud.nbytes == 4 * 4 * (3 + 3 + 4 + 1 + 3 + 3 * rest_count)
    low, high = cloud.bounds
    assert (low.tolist(), high.tolist(), low.dtype) == ([0, 1, 2], [9, 10, 11], np.float64)


def test_clouds_are_frozen_and_equal_only_to_themselves() -> None:
    cloud = SplatCloud(**arrays())
    assert cloud == cloud  # noqa: PLR0124
    assert cloud != SplatCloud(**arrays())
    assert {cloud: 1}[cloud] == 1
    with pytest.raises(dataclasses.FrozenInstanceError):
        cloud.name = "other"  # type: ignore[misc]


@pytest.mark.parametrize("name", list(arrays()))
@pytest.mark.parametrize("fault", ["rows", "columns", "dtype", "layout"])
def test_arrays_of_the_wrong_kind_are_refused(name: str, fault: str) -> None:
    given = arrays()
    array = given[name]
    given[name] = {
        "rows": array[:3],
        "columns": np.zeros((*array.shape, 2), np.float32),
        "dtype": array.astype(np.float64),
        "layout": np.repeat(array, 2, axis=0)[::2],
    }[fault]
    with pytest.raises(StippleError, match=r"^tree: \w+ is float\d+ .*contiguous float32 array, \("):
        SplatCloud(**given, name="tree")


@pytest.mark.parametrize("rest_count", [1, 4, 16, 35])
def test_an_incomplete_degree_is_refused(rest_count: int) -> None:
    with pytest.raises(StippleError, match=f"sh_rest has {rest_count} coefficients per channel"):
        SplatCloud(**arrays(4, rest_count))
    with pytest.raises(ValueError, match="not in"):
        sh_degree_of_rest_count(rest_count)


def test_no_splats_are_refused() -> None:
    with pytest.raises(StippleError, match="there are no splats"):
        SplatCloud(**arrays(0))


def masked(**changes: tuple[int, float]) -> list[bool]:
    given = arrays()
    for name, (row, value) in changes.items():
        given[name].reshape(4, -1)[row] = value
    sh = np.concatenate([given["sh_dc"][:, None], given["sh_rest"]], axis=1)
    return degenerate_mask(given["position"], given["scale"], given["rotation"], given["opacity"], sh).tolist()


@pytest.mark.parametrize("name", list(arrays()))
@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_values_that_are_not_finite_are_degenerate(name: str, value: float) -> None:
    assert masked(**{name: (2, value)}) == [False, False, True, False]


def test_negative_scales_and_zero_quaternions_are_degenerate() -> None:
    assert masked() == [False] * 4
    assert masked(scale=(0, -1e-6), rotation=(3, 0.0)) == [True, False, False, True]
    none = arrays(0)
    assert degenerate_mask(*(none[name] for name in ("position", "scale", "rotation", "opacity", "sh_rest"))).size == 0
    assert masked(scale=(1, 0.0), rotation=(1, 1e-6), opacity=(1, 0.0)) == [False] * 4
