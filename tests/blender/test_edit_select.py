# SPDX-License-Identifier: GPL-3.0-or-later
"""Edit Splats: what is selected by its place in the world and its size, by being revealed, and where there are few."""

from __future__ import annotations

import bpy
import numpy as np
import pytest

from stipple.addon.edit.mode import keep_rows
from stipple.engine.edit.state import SELECTED

from .captures import random_cloud
from .editing import edited, flags, positions, refused
from .test_edit_operators import scene

pytestmark = pytest.mark.blender


def test_by_size_and_by_plane() -> None:
    b_object, cloud = scene(), random_cloud(count=300, degree=1)
    bpy.ops.stipple.select_size(low=0.05, high=0.1)
    longest = cloud.scale.max(axis=1)
    assert np.array_equal(flags(b_object, SELECTED), (longest >= np.float32(0.05)) & (longest <= np.float32(0.1)))
    height = (cloud.position.astype(np.float64) - (0.2, 0, 0)) @ (1, 1, 0)
    bpy.ops.stipple.select_plane(point=(0.2, 0, 0), normal=(1, 1, 0))
    assert np.array_equal(flags(b_object, SELECTED), height >= 0) and 20 < (height >= 0).sum() < 280
    bpy.ops.stipple.select_plane(point=(0.2, 0, 0), normal=(1, 1, 0), side="BACK")
    assert np.array_equal(flags(b_object, SELECTED), height <= 0)
    with refused("direction"):
        bpy.ops.stipple.select_plane(normal=(0, 0, 0))


def test_the_box_of_an_object_is_that_of_a_crop() -> None:
    """An empty's cube as it is drawn, the bounding box of anything else."""
    b_object, b_box = scene(), bpy.data.objects["Box"]
    b_box.empty_display_size = 0.5
    corners = [(0, 0, 0), (0.8, 0, 0), (0, 0.9, 0), (0, 0, 1.5)]
    b_mesh = bpy.data.meshes.new("Mesh")
    b_mesh.from_pydata(corners, [], [(0, 1, 2)])
    b_corner = bpy.data.objects.new("Corner", b_mesh)
    bpy.context.scene.collection.objects.link(b_corner)
    bpy.context.view_layer.update()
    position = random_cloud(count=300, degree=1).position
    within = {
        "Box": (np.abs(position) <= np.float32(0.3)).all(axis=1),
        "Corner": ((position >= 0) & (position <= np.max(corners, axis=0))).all(axis=1),
    }
    for name, inside in within.items():
        bpy.ops.stipple.select_in_object(object=name)
        assert np.array_equal(flags(b_object, SELECTED), inside) and inside.any()
        bpy.ops.stipple.clean_outside(object=name)
        assert np.array_equal(flags(b_object, SELECTED), ~inside)
    b_box.scale.z = 0
    bpy.context.view_layer.update()
    for name, words in (("Box", "its box is flat"), ("Nowhere", "no object of that name")):
        with refused(name, words):
            bpy.ops.stipple.select_in_object(object=name)


def test_shear_leans_one_axis() -> None:
    b_object = scene()
    before, chosen = positions(b_object), flags(b_object, SELECTED)
    bpy.ops.stipple.shear(angle=np.arctan(0.5), axis="Y", across="X", pivot="ORIGIN")
    leaning = before + np.where(chosen[:, None], before[:, :1] * (0, 0.5, 0), 0)
    assert np.allclose(positions(b_object), leaning, atol=1e-6)
    with refused("two different axes"):
        bpy.ops.stipple.shear(angle=0.1, axis="Z")


def test_reveal_selects_unless_told_otherwise() -> None:
    b_object = scene()
    chosen = flags(b_object, SELECTED)
    bpy.ops.stipple.hide(unselected=True)
    bpy.ops.stipple.reveal(select=False)
    assert np.array_equal(flags(b_object, SELECTED), chosen)
    bpy.ops.stipple.hide(unselected=True)
    bpy.ops.stipple.reveal()
    assert flags(b_object, SELECTED).all()


def test_few_splats_and_none() -> None:
    b_object = edited(random_cloud(3))
    bpy.ops.stipple.select_linked(splat=0, distance=3.0)
    assert flags(b_object, SELECTED).all()
    with refused("Capture", "3 splats", "6 neighbors"):
        bpy.ops.stipple.clean_floaters()
    bpy.ops.stipple.hide()
    with refused("Capture", "fewer than two are shown"):
        bpy.ops.stipple.select_more()
    bpy.ops.stipple.edit_mode_toggle()
    keep_rows(b_object.data, np.zeros(3, bool), "Capture")
    for operator in (bpy.ops.stipple.edit_mode_toggle, bpy.ops.stipple.delete_invalid):
        with refused("Capture", "it has no splats"):
            operator()
    b_object.stipple_editing = True
    with refused("Capture", "it has no splats"):
        bpy.ops.stipple.select_all()
