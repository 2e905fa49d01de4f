# SPDX-License-Identifier: GPL-3.0-or-later
"""What is selected on the screen is what is seen there: crops, sizes, opacities and displays of the object count."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from stipple.engine.device import choose_device
from stipple.engine.edit.editable_cloud import EditableCloud
from stipple.engine.edit.mask import Mask
from stipple.engine.edit.match_screen import match_circle, match_depth, match_polygon, match_rectangle
from stipple.engine.edit.match_space import match_sphere
from stipple.engine.edit.match_visible import match_visible
from stipple.engine.look import Crop, Look
from stipple.engine.renderer import Renderer
from tests.scenes import front_camera, random_cloud

Clouds = Callable[..., EditableCloud]

CENTRE, RADIUS = (0.3, -0.2, 4.0), 1.1
BALL = tuple(map(tuple, np.column_stack([RADIUS * np.eye(3), CENTRE]).tolist()))
MATCHES: dict[str, Callable[..., Mask]] = {
    "circle": lambda cloud, **o: match_circle(cloud, front_camera(), (30, 20), 15, **o),
    "borders": lambda cloud, **o: match_circle(cloud, front_camera(), (30, 20), 8, border=True, **o),
    "rectangle": lambda cloud, **o: match_rectangle(cloud, front_camera(), (10, 8), (50, 40), **o),
    "lasso": lambda cloud, **o: match_polygon(cloud, front_camera(), [(5, 5), (60, 10), (30, 45)], **o),
    "depth": lambda cloud, **o: match_depth(cloud, front_camera(), 3.5, 4.6, **o),
}


@pytest.mark.parametrize("match", MATCHES)
def test_what_is_cropped_away_is_not_selected(make_cloud: Clouds, match: str) -> None:
    cloud = make_cloud()
    plain, ball = MATCHES[match](cloud), match_sphere(cloud, CENTRE, RADIUS)
    kept = MATCHES[match](cloud, look=Look(crops=(Crop(BALL, "sphere"),)))
    assert np.array_equal(kept.numpy(), (plain & ball).numpy())
    kept = MATCHES[match](cloud, look=Look(crops=(Crop(BALL, "sphere", "outside"),)))
    assert np.array_equal(kept.numpy(), (plain - ball).numpy())
    assert 20 < kept.count() < plain.count() - 20


@pytest.mark.parametrize("look", [Look(size=2.5), Look(opacity=0.2), Look(size=0.5, opacity=4.0)])
def test_borders_are_where_splats_are_drawn(device: str, look: Look) -> None:
    host = random_cloud(3_000, 1)
    cloud = EditableCloud.from_cloud(host, choose_device(device))
    dressed = replace(
        host,
        scale=np.float32(look.size) * host.scale,
        opacity=np.minimum(np.float32(look.opacity) * host.opacity, np.float32(1)),
    )
    expected = MATCHES["borders"](EditableCloud.from_cloud(dressed, choose_device(device))).numpy()
    assert np.array_equal(MATCHES["borders"](cloud, look=look).numpy(), expected)
    assert np.count_nonzero(expected != MATCHES["borders"](cloud).numpy()) > 20


@pytest.mark.parametrize("match", MATCHES)
def test_what_a_display_leaves_out_is_not_selected(make_cloud: Clouds, match: str) -> None:
    cloud = make_cloud()
    found = MATCHES[match](cloud, look=Look(display="points", least_opacity=0.5, point_px=2.0)).numpy()
    faint = cloud.host("opacity") < 0.5
    assert not found[faint].any()
    if match != "borders":
        assert np.array_equal(found, MATCHES[match](cloud).numpy() & ~faint)


def test_the_border_of_a_point_is_its_discs(make_cloud: Clouds) -> None:
    """Whose soft edge reaches 5 % further than the radius."""
    cloud = make_cloud()
    found = MATCHES["borders"](cloud, look=Look(display="points", least_opacity=0.0, point_px=12.0)).numpy()
    away = np.hypot(*(front_camera().project(cloud.host("position").astype(np.float64))[:, :2] - (30, 20)).T)
    assert found[away < 8 + 6].all() and not found[away > 8 + 6 * 1.06].any() and found.sum() > 50


def test_what_is_seen_is_seen_without_what_is_cropped_away(make_cloud: Clouds, device: str) -> None:
    cloud, renderer = make_cloud(20_000), Renderer(device)
    options: dict[str, Any] = {"camera": front_camera(), "renderer": renderer}
    half = Look(crops=(Crop(((9, 0, 0, 0), (0, 9, 0, 0), (0, 0, 1, 5.5))),))  # all that is farther than 4.5
    near = cloud.host("position")[:, 2] < 4.5
    plain, kept = match_visible(cloud, **options).numpy(), match_visible(cloud, look=half, **options).numpy()
    assert not kept[near].any()
    assert kept[~near].sum() > plain[~near].sum() + 100  # what was behind the others
