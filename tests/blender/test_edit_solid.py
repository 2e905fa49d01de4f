# SPDX-License-Identifier: GPL-3.0-or-later
"""Solid shading follows an edit: the overlay's colored points, and the radii of the points that Blender draws."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest

from stipple.addon.edit.solid import point_states, seen_flags
from stipple.addon.overlay_points import OVERLAY_GAMMA, overlay_points
from stipple.addon.splat_data import display_radius
from stipple.engine.edit.state_bits import DELETED, HIDDEN, HIGHLIGHT, SELECTED
from stipple.engine.formats import read_splats

from .captures import random_cloud, write_ply
from .editing import activate, edited, flags, positions
from .linked_editing import LEFT, edited_link

pytestmark = pytest.mark.blender

LARGE = 250_000  # splats, of which a proxy has every third


@pytest.fixture(params=["in the file", "linked"])
def b_object(request: pytest.FixtureRequest, tmp_path: Path) -> Any:
    """An edited capture of 500 splats; the proxy of the linked one has all of them, in the same order."""
    cloud = random_cloud(500)
    return edited(cloud) if request.param == "in the file" else edited_link(write_ply(tmp_path / "garden.ply", cloud))


def shown(b_object: Any, highlight: bool = True) -> Any:
    """What the overlay draws, sorted by place."""
    states = point_states(b_object.data)
    if states is not None:
        states &= np.uint32(seen_flags(b_object.stipple_editing, highlight))
    points = overlay_points(b_object.data, "it", states=states)
    order = np.lexsort(points.place[:, :3].T)
    return points.place[order], points.colour[order, :3] ** (1 / OVERLAY_GAMMA)


def sorted_rows(values: np.ndarray) -> np.ndarray:
    return values[np.lexsort(values.T)]


def radii(b_object: Any) -> np.ndarray | None:
    """Of the points that Blender draws; None of a mesh, of which it draws none."""
    b_attribute = b_object.data.attributes.get("radius")
    if b_attribute is None:
        return None
    values = np.empty(len(b_attribute.data), np.float32)
    b_attribute.data.foreach_get("value", values)
    return values


def test_what_is_hidden_or_deleted_is_not_drawn(b_object: Any) -> None:
    left = np.linalg.norm(positions(b_object) - (-1, 0, 0), axis=1) <= 1
    before = radii(b_object)
    bpy.ops.stipple.select_sphere(**LEFT)
    assert len(shown(b_object)[0]) == 500
    for away, back in (
        (bpy.ops.stipple.hide, bpy.ops.stipple.reveal),
        (bpy.ops.stipple.delete, bpy.ops.stipple.restore),
    ):
        away()
        assert np.array_equal(shown(b_object)[0][:, :3], sorted_rows(positions(b_object)[~left]))
        if before is not None:
            assert np.array_equal(radii(b_object), np.where(left, 0, before))
        back()
        assert len(shown(b_object)[0]) == 500
        assert before is None or np.array_equal(radii(b_object), before)


def test_what_is_selected_is_tinted(b_object: Any) -> None:
    plain = shown(b_object)[1]
    bpy.ops.stipple.select_sphere(**LEFT)
    place, tinted = shown(b_object)
    left = np.linalg.norm(place[:, :3] - (-1, 0, 0), axis=1) <= 1
    np.testing.assert_allclose(tinted[left], 0.5 * (plain[left] + HIGHLIGHT), atol=1e-5)
    np.testing.assert_array_equal(tinted[~left], plain[~left])
    np.testing.assert_array_equal(shown(b_object, highlight=False)[1], plain)


def test_outside_of_the_mode_only_what_is_deleted_is_gone(b_object: Any) -> None:
    bpy.ops.stipple.select_sphere(**LEFT)
    bpy.ops.stipple.hide()
    bpy.ops.stipple.select_sphere(center=(1, 0, 0), radius=0.8)
    bpy.ops.stipple.delete()
    gone = np.linalg.norm(positions(b_object) - (1, 0, 0), axis=1) <= 0.8
    bpy.ops.stipple.edit_mode_toggle()
    assert len(shown(b_object)[0]) == 500 - gone.sum()
    assert radii(b_object) is None or np.count_nonzero(radii(b_object)) == 500 - gone.sum()
    bpy.ops.stipple.edit_mode_toggle()
    assert len(shown(b_object)[0]) < 450  # what is hidden is hidden again
    assert radii(b_object) is None or np.count_nonzero(radii(b_object)) == len(shown(b_object)[0])


def test_leaving_goes_by_others_that_are_edited_with_the_same_data() -> None:
    b_object = edited(random_cloud(500))
    b_twin = b_object.copy()  # in Edit Splats, too
    bpy.context.scene.collection.objects.link(b_twin)
    bpy.ops.stipple.select_sphere(**LEFT)
    bpy.ops.stipple.hide()
    hidden = flags(b_object, HIDDEN)
    bpy.ops.stipple.edit_mode_toggle()
    assert radii(b_object) is None or np.array_equal(radii(b_object) == 0, hidden)
    activate(b_twin)
    bpy.ops.stipple.edit_mode_toggle()
    assert radii(b_object) is None or (radii(b_object) > 0).all()


def test_undo_brings_points_back(b_object: Any) -> None:
    before, name = radii(b_object), b_object.name
    bpy.ops.stipple.select_sphere(**LEFT)
    bpy.ops.ed.undo_push(message="Select")
    bpy.ops.stipple.delete()
    bpy.ops.ed.undo_push(message="Delete")
    bpy.ops.ed.undo()
    b_object = bpy.data.objects[name]
    assert len(shown(b_object)[0]) == 500
    assert before is None or np.array_equal(radii(b_object), before)


def test_scaled_splats_stay_hidden() -> None:
    b_object = edited(random_cloud(500))
    bpy.ops.stipple.select_sphere(**LEFT)
    bpy.ops.stipple.hide()
    bpy.ops.stipple.select_all(action="SELECT")
    bpy.ops.stipple.resize(value=(2, 2, 2))
    assert radii(b_object) is None or np.array_equal(radii(b_object) == 0, flags(b_object, HIDDEN))


def test_a_proxy_has_the_flags_of_its_splats(tmp_path: Path) -> None:
    b_object = edited_link(write_ply(tmp_path / "garden.ply", random_cloud(LARGE, degree=0)))
    assert b_object.data.stipple_capture.proxy_step == 3
    bpy.ops.stipple.select_sphere(**LEFT)
    bpy.ops.stipple.delete()
    position = read_splats(tmp_path / "garden.ply").cloud.position[::3]
    left = np.linalg.norm(position - (-1, 0, 0), axis=1) <= 1
    assert np.array_equal(point_states(b_object.data) == (SELECTED | DELETED), left)
    b_object.data.stipple_capture.proxy_step = 0  # of a file of before: nothing is known
    assert point_states(b_object.data) is None


def test_radii_are_those_of_the_middle_axis() -> None:
    scale = np.array([[1, 2, 3], [3, 1, 2], [2, 3, 1], [1, 3, 2], [2, 1, 3], [3, 2, 1], [2, 2, 1]], np.float32)
    np.testing.assert_array_equal(display_radius(scale, np.ones(7, np.float32)), np.full(7, 5, np.float32))
