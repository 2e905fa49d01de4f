# SPDX-License-Identifier: GPL-3.0-or-later
"""Selections find what NumPy finds in float64, combine as sets do, and come back as they were."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from stipple.engine import device as engine_device
from stipple.engine.edit.affine import composed
from stipple.engine.edit.editable_cloud import EditableCloud
from stipple.engine.edit.flags import counts, hide, lock
from stipple.engine.edit.history import History
from stipple.engine.edit.mask import Mask, mask_from_numpy
from stipple.engine.edit.match_screen import match_circle, match_depth, match_polygon, match_rectangle
from stipple.engine.edit.match_space import match_bounds, match_box, match_half_space, match_sphere
from stipple.engine.edit.match_values import match_colour, match_opacity, match_size
from stipple.engine.edit.selection import MODES, SelectionStroke, select, select_all
from stipple.engine.errors import StippleError
from stipple.engine.scene import Instance
from stipple.engine.splats import SH_C0
from tests.edit.every_byte import assert_same, every_byte
from tests.oracle.projection import project
from tests.scenes import front_camera

Clouds = Callable[..., EditableCloud]

TURNED = np.array([[0.8, -0.6, 0.0, 0.3], [0.54, 0.72, -0.4, -0.2], [0.2, 0.3, 1.1, 0.5]])


def means(cloud: EditableCloud, world_from_object: np.ndarray = TURNED) -> np.ndarray:
    return cloud.host("position").astype(np.float64) @ world_from_object[:, :3].T + world_from_object[:, 3]


def assert_found(found: Mask, signed: np.ndarray, margin: float = 1e-4) -> None:
    """`signed` is above 0 where a splat should be found; closer to 0 than the margin, rounding may decide."""
    sure = np.abs(signed) > margin
    assert sure.mean() > 0.99
    assert 0.02 < (signed > 0).mean() < 0.98
    np.testing.assert_array_equal(found.numpy()[sure], signed[sure] > 0)
    assert found.count() == found.numpy().sum()
    np.testing.assert_array_equal(found.indices().numpy(), np.flatnonzero(found.numpy()))


def test_sphere(make_cloud: Clouds) -> None:
    cloud = make_cloud()
    found = match_sphere(cloud, (0.2, -0.3, 4.0), 1.7, TURNED)
    assert_found(found, 1.7 - np.linalg.norm(means(cloud) - [0.2, -0.3, 4.0], axis=1))


def test_boxes(make_cloud: Clouds) -> None:
    cloud = make_cloud()
    box = composed(np.array([[1.2, 0.3, 0, 0], [0, 1.0, 0.2, 0.4], [0.1, 0, 1.5, 4.0]]), np.eye(3, 4))
    local = np.linalg.solve(box[:, :3], (means(cloud) - box[:, 3]).T).T
    assert_found(match_box(cloud, box, TURNED), 1 - np.abs(local).max(axis=1))
    low, high = np.array([-1.0, -1.0, 3.0]), np.array([1.0, 1.5, 5.0])
    inside = np.minimum(means(cloud) - low, high - means(cloud)).min(axis=1)
    assert_found(match_bounds(cloud, low, high, TURNED), inside)


def test_half_space(make_cloud: Clouds) -> None:
    cloud = make_cloud()
    normal = np.array([0.0, 3.0, 4.0])
    assert_found(
        match_half_space(cloud, (0, 0, 4), normal, TURNED), (means(cloud) - [0, 0, 4]) @ normal / np.linalg.norm(normal)
    )


def test_far_away_world_loses_nothing(make_cloud: Clouds) -> None:
    """A capture in national grid coordinates: single precision there has steps of half a unit."""
    cloud, away = make_cloud(), np.array([5.4e6, 3.1e6, 0.0])
    placed = np.column_stack([np.eye(3), away])
    centre = np.array([0.0, 0.0, 4.0])
    signed = 1.0 - np.linalg.norm(means(cloud, np.eye(3, 4)) - centre, axis=1)
    assert_found(match_sphere(cloud, away + centre, 1.0, placed), signed)


def pixels(cloud: EditableCloud) -> np.ndarray:
    return front_camera().project(means(cloud, np.eye(3, 4)))


@pytest.mark.parametrize("projection", ["pinhole", "orthographic"])
def test_circle_by_centres(make_cloud: Clouds, projection: str) -> None:
    cloud, camera = (
        make_cloud(),
        front_camera(projection=projection, **({} if projection == "pinhole" else {"fx": 15.0, "fy": 15.0})),
    )
    px = camera.project(means(cloud))
    found = match_circle(cloud, camera, (30, 20), 12, world_from_object=TURNED)
    assert_found(found, 12 - np.hypot(px[:, 0] - 30, px[:, 1] - 20), 1e-3)


def test_circle_by_borders_is_the_papers_test(make_cloud: Clouds) -> None:
    """Figure 13 in float64, from the oracle's covariances."""
    cloud, camera = make_cloud(2000), front_camera()
    host = cloud.to_cloud()
    ellipses = project(Instance(host), camera, dilation_px2=0.3, antialiased=False, alpha_min=1 / 255)
    values, axes = np.linalg.eigh(ellipses.covariance_px2)
    assert len(ellipses.index) == cloud.splat_count
    reach = np.sqrt(2 * np.log(host.opacity.astype(np.float64) * 255))
    offset = np.array([30.0, 20.0]) - ellipses.mean_px
    along = np.einsum("nji,nj->ni", axes, offset)
    signed = 1 - np.linalg.norm(along / (reach[:, None] * np.sqrt(values) + 5.0), axis=1)
    signed[np.hypot(*offset.T) < 5] = 1.0  # whose centre is under the brush, however faint
    found = match_circle(cloud, camera, (30, 20), 5, border=True)
    assert_found(found, signed, 1e-3)
    by_centre = match_circle(cloud, camera, (30, 20), 5)
    assert (by_centre - found).count() == 0 and found.count() > 2 * by_centre.count()


def test_rectangle_and_depth(make_cloud: Clouds) -> None:
    cloud = make_cloud()
    px = pixels(cloud)
    inside = np.minimum(px[:, :2] - [10, 8], [40, 30] - px[:, :2]).min(axis=1)
    assert_found(match_rectangle(cloud, front_camera(), (40, 8), (10, 30)), inside, 1e-3)
    assert_found(match_depth(cloud, front_camera(), 3, 4.5), np.minimum(px[:, 2] - 3, 4.5 - px[:, 2]))


def test_nothing_behind_the_camera(make_cloud: Clouds) -> None:
    cloud = make_cloud()
    behind = np.column_stack([np.diag([1.0, 1.0, -1.0]), np.zeros(3)])
    for found in (
        match_rectangle(cloud, front_camera(), (0, 0), (64, 48), behind),
        match_circle(cloud, front_camera(), (32, 24), 500, border=True, world_from_object=behind),
        match_polygon(cloud, front_camera(), [(0, 0), (64, 0), (64, 48), (0, 48)], behind),
    ):
        assert found.count() == 0


def test_lasso(make_cloud: Clouds) -> None:
    """A star that crosses itself, by even-odd, against a winding loop over all edges."""
    cloud = make_cloud()
    angle = np.arange(5) * 4 * np.pi / 5
    corners = np.column_stack([32 + 22 * np.sin(angle), 24 - 22.5 * np.cos(angle)])
    px = pixels(cloud)[:, :2]
    inside, nearest = np.zeros(len(px), bool), np.full(len(px), np.inf)
    for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        spans = (a[1] > px[:, 1]) != (b[1] > px[:, 1])
        inside ^= spans & (px[:, 0] < a[0] + (px[:, 1] - a[1]) * (b[0] - a[0]) / (b[1] - a[1]))
        t = np.clip((px - a) @ (b - a) / ((b - a) @ (b - a)), 0, 1)
        nearest = np.minimum(nearest, np.linalg.norm(px - a - t[:, None] * (b - a), axis=1))
    assert_found(match_polygon(cloud, front_camera(), corners), np.where(inside, nearest, -nearest), 1e-3)


def test_values(make_cloud: Clouds) -> None:
    cloud = make_cloud()
    host = cloud.to_cloud()
    assert_found(match_opacity(cloud, 0.3, 0.6), np.minimum(host.opacity - 0.3, 0.6 - host.opacity), 1e-7)
    w, x, y, z = host.rotation.astype(np.float64).T
    axes = np.empty((len(w), 3, 3))
    axes[:, 0] = np.column_stack([1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)])
    axes[:, 1] = np.column_stack([2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)])
    axes[:, 2] = np.column_stack([2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)])
    longest = (np.linalg.norm(TURNED[:, :3] @ axes, axis=1) * host.scale).max(axis=1)
    assert_found(match_size(cloud, 0.3, 0.5, TURNED), np.minimum(longest - 0.3, 0.5 - longest))


def oklab(srgb: np.ndarray) -> np.ndarray:
    """Ottosson's definition, by its XYZ-free matrices as published."""
    srgb = np.maximum(srgb, 0)
    linear = np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)
    lms = np.cbrt(
        linear
        @ np.array(
            [
                [0.4122214708, 0.5363325363, 0.0514459929],
                [0.2119034982, 0.6806995451, 0.1073969566],
                [0.0883024619, 0.2817188376, 0.6299787005],
            ]
        ).T
    )
    return (
        lms
        @ np.array(
            [
                [0.2104542553, 0.7936177850, -0.0040720468],
                [1.9779984951, -2.4285922050, 0.4505937099],
                [0.0259040371, 0.7827717662, -0.8086757660],
            ]
        ).T
    )


@pytest.mark.parametrize("weight", [1.0, 0.0])
def test_colour(make_cloud: Clouds, weight: float) -> None:
    cloud = make_cloud()
    colours = 0.5 + SH_C0 * cloud.host("sh_dc").astype(np.float64)
    away = (oklab(colours) - oklab(np.array([0.8, 0.3, 0.2]))) * [weight, 1, 1]
    found = match_colour(cloud, (0.8, 0.3, 0.2), 0.15, weight)
    assert_found(found, 0.15 - np.linalg.norm(away, axis=1))
    assert np.allclose(oklab(np.ones(3)), [1, 0, 0], atol=1e-6)


@pytest.mark.parametrize("mode", MODES)
def test_modes_are_those_of_sets_and_leave_protected_splats_alone(make_cloud: Clouds, mode: str) -> None:
    cloud = make_cloud(777)
    history = History(cloud)
    rng = np.random.default_rng(5)
    hidden, locked, first, match = (rng.random(777) < 0.4 for _ in range(4))
    for mask, operation in ((hidden, hide), (locked, lock)):
        history.do(select(cloud, mask_from_numpy(mask, cloud.device)))
        history.do(operation(cloud))
    history.do(select(cloud, mask_from_numpy(first, cloud.device)))
    before, free = every_byte(cloud), ~(hidden | locked)
    selected = cloud.selection().numpy()
    np.testing.assert_array_equal(selected, first & free)
    step = select(cloud, mask_from_numpy(match, cloud.device), mode)
    assert_same(cloud, before)
    history.do(step)
    wanted = {
        "set": match,
        "add": selected | match,
        "subtract": selected & ~match,
        "intersect": selected & match,
        "difference": selected ^ match,
    }[mode]
    np.testing.assert_array_equal(cloud.selection().numpy(), wanted & free)
    assert step.changed == ((wanted & free) ^ selected).sum()
    history.undo()
    assert_same(cloud, before)


def test_all_none_invert(make_cloud: Clouds) -> None:
    cloud = make_cloud(100)
    history = History(cloud)
    history.do(select_all(cloud))
    assert counts(cloud)["selected"] == 100
    history.do(select(cloud, match_opacity(cloud, 0.5)))
    some = counts(cloud)["selected"]
    history.do(select_all(cloud, "invert"))
    assert counts(cloud)["selected"] == 100 - some
    history.do(select_all(cloud, "none"))
    assert counts(cloud)["selected"] == 0


def test_a_brush_stroke_is_one_step(make_cloud: Clouds) -> None:
    cloud = make_cloud()
    history = History(cloud)
    history.do(select(cloud, match_opacity(cloud, 0.9)))
    before = every_byte(cloud)
    for mode in ("set", "add", "subtract"):
        stroke = SelectionStroke(cloud, mode)
        union = np.zeros(cloud.splat_count, bool)
        selected = cloud.selection().numpy()
        for x in range(10, 50, 5):
            match = match_circle(cloud, front_camera(), (x, 20), 8, border=True)
            stroke.dab(match)
            union |= match.numpy()
        wanted = {"set": union, "add": selected | union, "subtract": selected & ~union}[mode]
        np.testing.assert_array_equal(cloud.selection().numpy(), wanted)
        if mode == "add":
            stroke.cancel()
        else:
            history.record(stroke.finish())
            assert history.undo_step.nbytes <= cloud.splat_count / 8 + 64
            history.undo()
        assert_same(cloud, before)


def test_threads_change_no_bit(make_cloud: Clouds) -> None:
    cloud, before = make_cloud(50_000), engine_device.thread_count()
    found = []
    try:
        for threads in (1, 2, 7):
            engine_device.set_thread_count(threads)
            found.append(match_circle(cloud, front_camera(), (30, 20), 9, border=True).words.numpy())
    finally:
        engine_device.set_thread_count(before)
    assert np.array_equal(found[0], found[1]) and np.array_equal(found[0], found[2])


def test_bad_calls_say_why(make_cloud: Clouds) -> None:
    cloud = make_cloud(50)
    before = every_byte(cloud)
    camera = front_camera()
    for call, words in (
        (lambda: match_sphere(cloud, (0, 0, 0), 0.0), "radius"),
        (lambda: match_circle(cloud, camera, (np.nan, 0), 5), "circle"),
        (lambda: match_polygon(cloud, camera, [(0, 0), (1, 1)]), "three corners"),
        (lambda: match_half_space(cloud, (0, 0, 0), (0, 0, 0)), "direction"),
        (lambda: match_bounds(cloud, (0, 0, 0), (1, 0, 1)), "enclose nothing"),
        (lambda: match_box(cloud, np.zeros((3, 4))), "flattens"),
        (lambda: match_sphere(cloud, (0, 0, 0), 1, np.diag([1.0, 0, 1, 1])), "flattens"),
        (lambda: match_depth(cloud, camera, 5, 2), "nearer"),
        (lambda: match_opacity(cloud, 1, 0), "smaller"),
        (lambda: match_colour(cloud, (0, 0), 1), "three"),
        (lambda: select(cloud, match_opacity(cloud), "xor"), "choose one of"),
        (lambda: select_all(cloud, "some"), "choose one of"),
        (lambda: select(cloud, match_opacity(make_cloud(51))), "one capture"),
        (lambda: hide(cloud), "nothing is selected"),
    ):
        with pytest.raises(StippleError, match=words):
            call()
    assert_same(cloud, before)
