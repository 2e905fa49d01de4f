# SPDX-License-Identifier: GPL-3.0-or-later
"""Object > Apply > Splat Transform: the picture stays, the object's transform goes."""

from __future__ import annotations

from pathlib import Path

import bpy
import numpy as np
import pytest
from mathutils import Euler, Matrix

from stipple.addon.splat_data import cloud_from_datablock
from tests.stats.image_metrics import psnr

from .captures import add_camera, add_capture, assert_same_cloud, random_cloud, render, use_stipple

pytestmark = pytest.mark.blender


def placed_capture(scale: tuple[float, float, float] = (0.7, 0.7, 0.7), degree: int = 3):  # type: ignore[no-untyped-def]
    """A selected, active, transformed capture in front of a camera."""
    use_stipple(160, 120)
    add_camera()
    b_object = add_capture(random_cloud(400, degree, size=0.15))
    b_object.location = (0.2, 0.5, -0.1)
    b_object.rotation_euler = Euler((0.5, -1.1, 2.0))
    b_object.scale = scale
    b_object.select_set(True)
    bpy.context.view_layer.objects.active = b_object
    bpy.context.view_layer.update()
    return b_object


@pytest.mark.parametrize("location", [True, False])
def test_the_picture_stays(tmp_path: Path, location: bool) -> None:
    b_object = placed_capture()
    before = render(tmp_path / "before.exr")
    assert bpy.ops.object.stipple_apply_transform(location=location) == {"FINISHED"}
    bpy.context.view_layer.update()
    kept = (0, 0, 0) if location else (0.2, 0.5, -0.1)
    np.testing.assert_allclose(b_object.matrix_world, Matrix.Translation(kept), atol=1e-6)
    assert before[..., 3].mean() > 0.1
    assert psnr(render(tmp_path / "after.exr"), before) > 60


def test_uneven_scale_keeps_shapes(tmp_path: Path) -> None:
    placed_capture(scale=(1.3, 0.5, 0.8), degree=0)
    before = render(tmp_path / "before.exr")
    bpy.ops.object.stipple_apply_transform()
    assert psnr(render(tmp_path / "after.exr"), before) > 60


@pytest.mark.parametrize(("scale", "degree", "says"), [(1.5, 2, True), (1.5, 0, False), (0.7, 2, False)])
def test_uneven_scale_says_that_colors_are_approximate(scale: float, degree: int, says: bool, capfd) -> None:  # type: ignore[no-untyped-def]
    """The direction a splat is seen from changes unevenly, too, which no harmonics of the same degree follow."""
    placed_capture(scale=(0.7, 0.7, scale), degree=degree)
    assert bpy.ops.object.stipple_apply_transform() == {"FINISHED"}
    assert (
        "Capture: its scale was uneven, so its view-dependent color is approximate" in capfd.readouterr().out
    ) == says


def test_children_stay_where_they_are() -> None:
    b_object = placed_capture()
    b_child = bpy.data.objects.new("Child", None)
    b_child.parent = b_object
    b_child.location = (1, 2, 3)
    bpy.context.scene.collection.objects.link(b_child)
    bpy.context.view_layer.update()
    before = b_child.matrix_world.copy()
    bpy.ops.object.stipple_apply_transform()
    bpy.context.view_layer.update()
    np.testing.assert_allclose(b_child.matrix_world, before, atol=1e-5)


def test_undo_restores_every_bit() -> None:
    b_object = placed_capture()
    bpy.ops.ed.undo_push(message="before")
    before, _ = cloud_from_datablock(b_object.data, "before")
    bpy.ops.object.stipple_apply_transform()
    bpy.ops.ed.undo_push(message="after")
    bpy.ops.ed.undo()
    b_object = bpy.data.objects["Capture"]
    after, _ = cloud_from_datablock(b_object.data, "after")
    assert before is not None and after is not None
    assert_same_cloud(before, after)
    np.testing.assert_allclose(b_object.scale, (0.7, 0.7, 0.7), rtol=1e-6)


def test_a_fake_user_is_none() -> None:
    placed_capture().data.use_fake_user = True
    assert bpy.ops.object.stipple_apply_transform() == {"FINISHED"}


def test_what_keys_would_do_again_is_refused(tmp_path: Path) -> None:
    """Also what drivers and strips would; the location only where it is applied."""
    b_object = placed_capture()
    b_object.delta_location = (0.3, 0.0, 0.0)
    b_object.keyframe_insert("location", frame=1)
    with pytest.raises(RuntimeError, match="Capture: its location is keyed or driven and would act on the new splats"):
        bpy.ops.object.stipple_apply_transform()
    b_object.driver_add("rotation_euler", 2)
    with pytest.raises(RuntimeError, match="its rotation_euler is keyed or driven"):
        bpy.ops.object.stipple_apply_transform(location=False)
    b_object.driver_remove("rotation_euler")
    bpy.context.scene.frame_set(1)
    before = render(tmp_path / "before.exr")
    assert bpy.ops.object.stipple_apply_transform(location=False) == {"FINISHED"}
    assert psnr(render(tmp_path / "after.exr"), before) > 60
    b_object.keyframe_insert("scale", frame=1)
    b_track = b_object.animation_data.nla_tracks.new()
    b_strip = b_track.strips.new("Strip", 1, b_object.animation_data.action)
    b_strip.action_slot = b_object.animation_data.action_slot
    b_object.animation_data.action = None
    with pytest.raises(RuntimeError, match="its scale, location is keyed or driven"):
        bpy.ops.object.stipple_apply_transform()


def test_an_object_that_plays_a_sequence_is_refused() -> None:
    """Its files stay as they are."""
    b_object = placed_capture()
    b_object.stipple_sequence.enabled = True
    with pytest.raises(RuntimeError, match="Capture: it plays a sequence of files, which stay as they are; turn the"):
        bpy.ops.object.stipple_apply_transform()


def test_refusals_change_nothing() -> None:
    b_object = placed_capture()
    b_twin = b_object.copy()
    bpy.context.scene.collection.objects.link(b_twin)
    before, _ = cloud_from_datablock(b_object.data, "before")
    with pytest.raises(RuntimeError, match="has 2 users; use Object > Relations > Make Single User"):
        bpy.ops.object.stipple_apply_transform()
    bpy.data.objects.remove(b_twin)
    b_object.scale = (1, 0, 1)
    with pytest.raises(RuntimeError, match="flattens the capture"):
        bpy.ops.object.stipple_apply_transform()
    b_object.select_set(False)
    with pytest.raises(RuntimeError, match="poll"):
        bpy.ops.object.stipple_apply_transform()
    after, _ = cloud_from_datablock(b_object.data, "after")
    assert before is not None and after is not None
    assert_same_cloud(before, after)
