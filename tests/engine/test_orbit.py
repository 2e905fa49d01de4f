# SPDX-License-Identifier: GPL-3.0-or-later
"""The orbit: what it frames, and how its cameras stand."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from stipple.engine.errors import StippleError
from stipple.engine.formats import read_splats
from stipple.engine.orbit import UP_AXES, Framing, frame_clouds, orbit, weighted_quantiles
from stipple.engine.splats import SplatCloud


def ball(count: int, centre: tuple[float, float, float], radius: float, opacity: float = 0.8) -> SplatCloud:
    rng = np.random.default_rng(3)
    direction = rng.normal(size=(count, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    position = np.array(centre) + radius * direction * rng.random((count, 1)) ** (1 / 3)
    return SplatCloud(
        position=position.astype(np.float32),
        scale=np.full((count, 3), 0.01, np.float32),
        rotation=np.tile(np.array([1, 0, 0, 0], np.float32), (count, 1)),
        opacity=np.full(count, opacity, np.float32),
        sh_dc=np.zeros((count, 3), np.float32),
        sh_rest=np.zeros((count, 0, 3), np.float32),
    )


def test_weighted_quantiles_count_weights() -> None:
    values, weights = np.array([3.0, 1.0, 2.0]), np.array([1.0, 1.0, 8.0])
    assert weighted_quantiles(values, weights, (0.05, 0.5, 0.95)).tolist() == [1.0, 2.0, 3.0]


def test_framing_finds_a_ball() -> None:
    framing = frame_clouds([ball(5000, (1, -2, 3), 2.0)])
    np.testing.assert_allclose(framing.centre, [1, -2, 3], atol=0.06)
    assert framing.radius == pytest.approx(2.0 * 0.9 ** (1 / 3), rel=0.02)


def test_framing_ignores_floaters_and_faint_splats() -> None:
    subject, plain = ball(5000, (0, 0, 0), 1.0), frame_clouds([ball(5000, (0, 0, 0), 1.0)])
    floaters = ball(100, (400, 0, 90), 30.0)
    fog = ball(5000, (9, 9, 9), 5.0, opacity=0.01)
    framing = frame_clouds([subject, floaters, fog])
    np.testing.assert_allclose(framing.centre, plain.centre, atol=0.1)
    assert framing.radius == pytest.approx(plain.radius, rel=0.1)


def test_framing_of_several_clouds_holds_all_of_them() -> None:
    framing = frame_clouds([ball(2000, (-3, 0, 0), 1.0), ball(2000, (3, 0, 0), 1.0)])
    np.testing.assert_allclose(framing.centre, 0, atol=0.1)
    assert 3 < framing.radius < 4.2


def test_one_splat_has_a_framing() -> None:
    framing = frame_clouds([ball(1, (5, 0, 0), 0.0)])
    np.testing.assert_allclose(framing.centre, [5, 0, 0])
    assert framing.radius == pytest.approx(0.03, rel=1e-6)


@pytest.mark.parametrize("up", UP_AXES)
@pytest.mark.parametrize("size", [(200, 100), (100, 200)])
def test_the_sphere_touches_the_nearer_edges(up: str, size: tuple[int, int]) -> None:
    framing = Framing(np.array([1.0, 2.0, 3.0]), 2.0)
    up_axis = np.array(UP_AXES[up][0])
    for camera in orbit(framing, 5, width=size[0], height=size[1], up=up):
        centre, above = camera.project([framing.centre, framing.centre + 0.1 * up_axis])
        np.testing.assert_allclose(centre[:2], [size[0] / 2, size[1] / 2], atol=1e-9)
        assert above[1] < centre[1] and abs(above[0] - centre[0]) < 1e-9
        # The cone around the sphere has its half angle's tangent times the focal length as radius.
        cone = camera.fx * np.tan(np.arcsin(2.0 / centre[2]))
        assert cone == pytest.approx(min(size) / 2)
        assert (camera.position - framing.centre) @ up_axis == pytest.approx(centre[2] * np.sin(np.pi / 18))


def test_views_go_round_evenly() -> None:
    positions = np.array([camera.position for camera in orbit(Framing(np.zeros(3), 1.0), 4, elevation=0.0)])
    distance = np.linalg.norm(positions[0])
    # Anticlockwise seen from above, where above is −y: from +z over −x to −z.
    expected = np.array([[0, 0, 1], [-1, 0, 0], [0, 0, -1], [1, 0, 0]]) * distance
    np.testing.assert_allclose(positions, expected, atol=1e-12)


def test_a_tiny_capture_is_not_clipped_away() -> None:
    (camera,) = orbit(Framing(np.zeros(3), 1e-3), 1)
    assert camera.near < np.linalg.norm(camera.position) - 1e-3


BAD: dict[str, tuple[int, dict[str, Any], str]] = {
    "count": (0, {}, "0 views"),
    "size": (1, {"width": 0}, "0×720"),
    "lens": (1, {"fov_y": np.pi}, "field of view is 180"),
    "elevation": (1, {"elevation": np.pi / 2}, "elevation is 90"),
    "axis": (1, {"up": "w"}, "up axis is 'w'"),
}


@pytest.mark.parametrize("case", BAD)
def test_impossible_orbits_are_refused(case: str) -> None:
    count, options, words = BAD[case]
    with pytest.raises(StippleError, match=words):
        orbit(Framing(np.zeros(3), 1.0), count, **options)
    with pytest.raises(StippleError, match="at least one capture"):
        frame_clouds([])


@pytest.mark.real
@pytest.mark.parametrize(("name", "up"), [("koala", "-y"), ("rubber_toy_cloud", "y")])
def test_a_real_capture_fills_the_picture(shared_data: Path, name: str, up: str) -> None:
    cloud = read_splats(shared_data / "real" / f"{name}.ply").cloud
    for camera in orbit(frame_clouds([cloud]), 6, width=640, height=480, up=up):
        x, y, _ = camera.project(cloud.position).T
        assert np.mean((x > 0) & (x < 640) & (y > 0) & (y < 480)) > 0.97
        assert np.ptp(y) > 150 and np.ptp(x) > 250
