# SPDX-License-Identifier: GPL-3.0-or-later
"""Where objects stand after Join and Align, and what is said where they could not stand there."""

from __future__ import annotations

from typing import Any

import bpy
import numpy as np
import pytest
from mathutils import Euler, Matrix

from stipple.engine.edit.transform import transform_cloud

from .captures import add_capture, random_cloud
from .editing import activate, assert_close, cloud_of, every_byte, part, refused

pytestmark = pytest.mark.blender
PLACED = Matrix.LocRotScale((1, 2, -3), Euler((0.3, -0.5, 1.1)), (1.5, 1.5, 1.5))


def with_child(scale: tuple[float, float, float]) -> tuple[Any, Any]:
    """A turned capture and its child, the active one of both, which are selected."""
    b_parent, b_child = add_capture(random_cloud(), "Parent"), add_capture(random_cloud(seed=2), "Child")
    b_parent.location, b_parent.rotation_euler, b_parent.scale = (3, 0, 0), (0.1, 0.7, 0.3), scale
    b_child.parent, b_child.rotation_euler = b_parent, (0.9, 0.2, 0.4)
    activate(b_child)
    b_parent.select_set(True)
    bpy.context.view_layer.update()
    return b_parent, b_child


def test_children_of_what_is_joined_stay_where_they_are() -> None:
    b_parent, b_child = with_child((2, 2, 2))
    b_empty = bpy.data.objects.new("Empty", None)
    bpy.context.scene.collection.objects.link(b_empty)
    b_empty.parent, b_empty.location = b_parent, (1, 1, 1)
    bpy.context.view_layer.update()
    before = [b_one.matrix_world.copy() for b_one in (b_child, b_empty)]
    seen = transform_cloud(cloud_of(b_parent), np.array(b_parent.matrix_world)[:3])
    assert bpy.ops.stipple.join() == {"FINISHED"}
    bpy.context.view_layer.update()
    for b_one, b_matrix in zip((b_child, b_empty), before, strict=True):
        assert b_one.parent is None and np.allclose(b_one.matrix_world, b_matrix, atol=1e-5)
    joined = transform_cloud(cloud_of(b_child), np.array(b_child.matrix_world)[:3])
    assert_close(part(joined, np.arange(200, 400)), seen, 1e-4)


def test_join_refuses_where_a_child_could_not_stay() -> None:
    b_parent, b_child = with_child((1, 3, 0.5))
    before, b_matrix = every_byte(b_child.data), b_child.matrix_world.copy()
    with refused("Child", "sheared", "parent Parent"):
        bpy.ops.stipple.join()
    bpy.context.view_layer.update()
    assert every_byte(b_child.data) == before and b_child.parent == b_parent and b_child.matrix_world == b_matrix


def pairs_of(b_matrix: Matrix) -> dict[str, Any]:
    """Three points in the world, and where a matrix brings them, as Align's arguments."""
    source = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0.5]])
    target = source @ np.array(b_matrix)[:3, :3].T + np.array(b_matrix)[:3, 3]
    points = {f"source_{i + 1}": tuple(p) for i, p in enumerate(source)}
    return points | {f"target_{i + 1}": tuple(p) for i, p in enumerate(target)}


def test_three_points_align_an_object() -> None:
    b_object = add_capture(random_cloud())
    activate(b_object)
    points = pairs_of(PLACED)
    assert bpy.ops.stipple.align_points(**points) == {"FINISHED"}
    assert np.allclose(b_object.matrix_world, PLACED, atol=1e-5)
    with refused("line"):
        bpy.ops.stipple.align_points(**(points | {"source_3": (2, 0, 0)}))
    with refused("one place"):
        bpy.ops.stipple.align_points(**(points | {"source_2": (1e-20, 0, 0), "source_3": (0, 1e-20, 0)}))


def placed_by_a_parent(b_object: Any) -> None:
    b_empty = bpy.data.objects.new("Empty", None)
    bpy.context.scene.collection.objects.link(b_empty)
    b_empty.scale, b_empty.rotation_euler, b_object.parent = (1, 3, 0.5), (0.3, 0.2, 0.1), b_empty


def placed_by_a_constraint(b_object: Any) -> None:
    b_object.constraints.new("LIMIT_LOCATION").use_max_x = True


def placed_by_keys(b_object: Any) -> None:
    b_object.keyframe_insert("rotation_euler", frame=1)


def placed_by_strips(b_object: Any) -> None:
    placed_by_keys(b_object)
    b_animation = b_object.animation_data
    b_animation.nla_tracks.new().strips.new("Keys", 1, b_animation.action)
    b_animation.action = None


def placed_by_a_driver(b_object: Any) -> None:
    b_object.driver_add("location", 0).driver.expression = "3"


@pytest.mark.parametrize(("place", "words"), [
    (placed_by_a_parent, ("uneven scale", "parent Empty")),
    (placed_by_a_constraint, ("constraints (Limit Location)",)),
    (placed_by_keys, ("keyframes",)),
    (placed_by_strips, ("keyframes",)),
    (placed_by_a_driver, ("drivers",)),
])  # fmt: skip
def test_align_refuses_where_the_object_would_stand_elsewhere(place: Any, words: tuple[str, ...]) -> None:
    b_object = add_capture(random_cloud())
    activate(b_object)
    place(b_object)
    bpy.context.view_layer.update()
    b_matrix, before = b_object.matrix_world.copy(), tuple(b_object.rotation_euler)
    with refused("Capture", *words):
        bpy.ops.stipple.align_points(**pairs_of(PLACED))
    bpy.context.view_layer.update()
    assert b_object.matrix_world == b_matrix and tuple(b_object.rotation_euler) == before
