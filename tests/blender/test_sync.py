# SPDX-License-Identifier: GPL-3.0-or-later
"""What of a Blender scene reaches the engine: instances, matrices, visibility, background, settings."""

from __future__ import annotations

from typing import Any

import bpy
import numpy as np
import pytest

from stipple.addon import residency
from stipple.addon.residency import CloudCache
from stipple.addon.splat_data import datablock_from_cloud
from stipple.addon.sync import scene_from_depsgraph, settings_from_scene
from stipple.engine.errors import StippleError
from stipple.engine.scene import Scene

from .captures import add_capture, assert_same_cloud, in_viewport, random_cloud

pytestmark = pytest.mark.blender


def synced(cache: CloudCache | None = None) -> Scene:
    scene, warnings = scene_from_depsgraph(
        bpy.context.evaluated_depsgraph_get(), CloudCache() if cache is None else cache
    )
    assert warnings == ()
    return scene


def matrices(scene: Scene) -> list[np.ndarray]:
    return [instance.world_from_object for instance in scene.instances]


def add_empty(name: str, **values: Any) -> Any:
    b_empty = bpy.data.objects.new(name, None)
    bpy.context.scene.collection.objects.link(b_empty)
    for key, value in values.items():
        setattr(b_empty, key, value)
    return b_empty


def test_a_capture_arrives_with_its_matrix_and_every_bit() -> None:
    cloud = random_cloud(degree=3)
    b_object = add_capture(cloud, "Koala")
    b_object.location, b_object.scale, b_object.rotation_euler = (1, 2, 3), (0.5, -2.0, 1.5), (0.3, 0.2, 0.1)
    b_object.pass_index = 7
    (instance,) = synced().instances
    assert (instance.name, instance.object_index) == ("Koala", 7)
    np.testing.assert_array_equal(instance.world_from_object, np.array(b_object.matrix_world)[:3])
    assert np.linalg.det(instance.world_from_object[:, :3]) < 0
    assert_same_cloud(instance.cloud, cloud)


def test_parents_shear_children() -> None:
    b_object = add_capture(random_cloud())
    b_object.parent = add_empty("Parent", scale=(3.0, 1.0, 1.0), location=(0.0, 0.0, 5.0))
    b_object.rotation_euler = (0.0, 0.0, 0.7)
    (matrix,) = matrices(synced())
    turn = np.array([[np.cos(0.7), -np.sin(0.7), 0], [np.sin(0.7), np.cos(0.7), 0], [0, 0, 1]])
    np.testing.assert_allclose(matrix[:, :3], np.diag([3.0, 1.0, 1.0]) @ turn, atol=1e-6)
    np.testing.assert_allclose(matrix[:, 3], (0, 0, 5))


def test_collection_instances_share_one_cloud() -> None:
    b_object = add_capture(random_cloud())
    b_collection = bpy.data.collections.new("Set")
    bpy.context.scene.collection.objects.unlink(b_object)
    b_collection.objects.link(b_object)
    b_object.location = (1.0, 0.0, 0.0)
    for index in range(3):
        add_empty(
            f"Copy {index}",
            instance_type="COLLECTION",
            instance_collection=b_collection,
            location=(0.0, index, 0.0),
            scale=(1.0, 1.0, 1.0 + index),
        )
    scene = synced()
    assert len({id(instance.cloud) for instance in scene.instances}) == 1
    found = sorted((tuple(matrix[:, 3]), matrix[2, 2]) for matrix in matrices(scene))
    assert found == [((1.0, float(i), 0.0), 1.0 + i) for i in range(3)]


def test_linked_duplicates_and_copies_share_one_cloud() -> None:
    b_object = add_capture(random_cloud())
    b_linked, b_copy = b_object.copy(), b_object.copy()
    b_copy.data = b_object.data.copy()
    for b_other in (b_linked, b_copy):
        bpy.context.scene.collection.objects.link(b_other)
    scene = synced()
    assert len(scene.instances) == 3
    assert len({id(instance.cloud) for instance in scene.instances}) == 1


def test_transforms_follow_the_animation_and_clouds_stay() -> None:
    b_object = add_capture(random_cloud())
    for frame, x in ((1, 0.0), (11, 10.0)):
        b_object.location.x = x
        b_object.keyframe_insert("location", frame=frame)
    cache, clouds, xs = CloudCache(), [], []
    for frame in (1, 11):
        bpy.context.scene.frame_set(frame)
        (instance,) = synced(cache).instances
        clouds.append(instance.cloud)
        xs.append(instance.world_from_object[0, 3])
    np.testing.assert_allclose(xs, (0, 10), atol=1e-6)
    assert clouds[0] is clouds[1]


def test_changed_splats_make_a_new_cloud_and_the_old_one_goes() -> None:
    b_object = add_capture(random_cloud())
    cache = CloudCache()
    (before,) = synced(cache).instances
    values = np.empty(3 * before.cloud.splat_count, np.float32)
    b_object.data.attributes["position"].data.foreach_get("vector", values)
    values[0] += 1
    b_object.data.attributes["position"].data.foreach_set("vector", values)
    b_object.data.update_tag()
    (after,) = synced(cache).instances
    assert after.cloud is not before.cloud
    assert after.cloud.position[0, 0] == before.cloud.position[0, 0] + 1
    assert len(cache) == 1


def test_view_layers_with_different_captures_keep_all_clouds() -> None:
    for name in ("One", "Two"):
        b_collection = bpy.data.collections.new(name)
        bpy.context.scene.collection.children.link(b_collection)
        b_object = bpy.data.objects.new(name, datablock_from_cloud(random_cloud(seed=len(name) + ord(name[0])), name))
        b_collection.objects.link(b_object)
    b_layers = [bpy.context.view_layer, bpy.context.scene.view_layers.new("Second")]
    b_layers[0].layer_collection.children["Two"].exclude = True
    b_layers[1].layer_collection.children["One"].exclude = True
    cache = CloudCache()
    seen = []
    for b_layer in b_layers * 2:
        b_layer.update()
        scene, _ = scene_from_depsgraph(b_layer.depsgraph, cache)
        seen.append(scene.instances)
    assert [[instance.name for instance in instances] for instances in seen] == [["One"], ["Two"]] * 2
    assert seen[0][0].cloud is seen[2][0].cloud and seen[1][0].cloud is seen[3][0].cloud


def test_hidden_captures_are_left_out() -> None:
    for name in ("Seen", "Camera ray", "Squashed", "Excluded"):
        add_capture(random_cloud(), name)
    bpy.data.objects["Camera ray"].visible_camera = False
    bpy.data.objects["Squashed"].scale = (0.0, 0.0, 0.0)
    b_collection = bpy.data.collections.new("Excluded")
    bpy.context.scene.collection.children.link(b_collection)
    b_collection.objects.link(bpy.data.objects["Excluded"])
    bpy.context.scene.collection.objects.unlink(bpy.data.objects["Excluded"])
    bpy.context.view_layer.layer_collection.children["Excluded"].exclude = True
    add_empty("Not a capture")
    b_mesh_object = bpy.data.objects.new("Mesh", bpy.data.meshes.new("Mesh"))
    bpy.context.scene.collection.objects.link(b_mesh_object)
    assert [instance.name for instance in synced().instances] == ["Seen"]


def test_collections_seen_only_indirectly_are_not_and_holdouts_are_named() -> None:
    add_capture(random_cloud(), "Alone")
    b_collection = bpy.data.collections.new("Set")
    bpy.context.scene.collection.children.link(b_collection)
    b_inside = add_capture(random_cloud(), "Inside")
    bpy.context.scene.collection.objects.unlink(b_inside)
    b_collection.objects.link(b_inside)
    b_layer_collection = bpy.context.view_layer.layer_collection.children["Set"]
    assert len(synced().instances) == 2
    b_layer_collection.indirect_only = True
    assert [instance.name for instance in synced().instances] == ["Alone"]
    b_layer_collection.indirect_only, b_layer_collection.holdout = False, True
    _, warnings = scene_from_depsgraph(bpy.context.evaluated_depsgraph_get(), CloudCache())
    assert len(warnings) == 1 and "Inside" in warnings[0] and "holdout" in warnings[0]
    b_layer_collection.holdout, bpy.data.objects["Alone"].is_holdout = False, True
    _, warnings = scene_from_depsgraph(bpy.context.evaluated_depsgraph_get(), CloudCache())
    assert len(warnings) == 1 and "Alone" in warnings[0]


def test_broken_captures_are_named() -> None:
    b_object = add_capture(random_cloud(), "Statue")
    b_object.data.attributes.remove(b_object.data.attributes["scale"])
    with pytest.raises(StippleError, match="Statue: the point attribute 'scale' is missing"):
        synced()


def test_a_broken_capture_takes_no_other_from_the_viewport() -> None:
    add_capture(random_cloud(), "Koala")
    b_object = add_capture(random_cloud(seed=2), "Statue")
    b_object.data.attributes.remove(b_object.data.attributes["scale"])
    instances, warnings = in_viewport()
    assert [instance.name for instance in instances] == ["Koala"]
    (warning,) = warnings
    assert warning.startswith("Statue: the point attribute 'scale' is missing")


def test_invalid_splats_are_counted() -> None:
    cloud = random_cloud()
    cloud.position[:3] = np.nan
    add_capture(cloud, "Statue")
    scene, warnings = scene_from_depsgraph(bpy.context.evaluated_depsgraph_get(), CloudCache())
    assert scene.splat_count == cloud.splat_count - 3
    assert warnings == ("Statue: 3 splats have invalid values and are not rendered.",)


def test_settings_follow_the_scene() -> None:
    b_scene = bpy.context.scene
    defaults = settings_from_scene(b_scene)
    assert (defaults.method, defaults.device, defaults.sh_degree, defaults.points_per_thread) == (
        "sorted",
        "auto",
        None,
        1,
    )
    assert defaults.alpha_max == pytest.approx(0.99)
    assert defaults.dilation_px2 == pytest.approx(0.3)
    for name, value in {
        "method": "POINTS",
        "ray_order": "STOCHASTIC",
        "samples": 9,
        "supersampling": 3,
        "seed": 5,
        "device": "CPU",
        "sh_degree": 1,
        "antialiased": True,
        "dilation_px2": 0.125,
        "points_per_thread": 4,
        "storage": "QUANTISED",
    }.items():
        setattr(b_scene.stipple, name, value)
    settings = settings_from_scene(b_scene)
    assert (settings.method, settings.samples, settings.supersampling, settings.seed) == ("points", 9, 3, 5)
    assert (settings.ray_order, settings.dilation_px2, settings.storage) == ("stochastic", 0.125, "quantised")
    assert (settings.device, settings.sh_degree, settings.antialiased, settings.points_per_thread) == (
        "cpu",
        1,
        True,
        4,
    )


def test_loading_a_file_frees_the_clouds() -> None:
    add_capture(random_cloud())
    synced(residency.clouds)
    assert len(residency.clouds) == 1
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    assert len(residency.clouds) == 0
