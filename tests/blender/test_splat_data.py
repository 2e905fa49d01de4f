# SPDX-License-Identifier: GPL-3.0-or-later
"""Splats in datablocks: bit by bit there and back, through files, copies, undo and Geometry Nodes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest

from stipple.addon.content_keys import key_after, key_of
from stipple.addon.splat_data import (
    BASE,
    cloud_from_datablock,
    datablock_from_cloud,
    is_capture,
    splat_count_of,
    write_arrays,
    write_attribute,
)
from stipple.engine.errors import StippleError
from stipple.engine.splats import ARRAY_NAMES, SplatCloud

from .captures import add_capture, assert_same_cloud, random_cloud

pytestmark = pytest.mark.blender


def read_back(b_data: Any) -> SplatCloud:
    cloud, dropped = cloud_from_datablock(b_data, b_data.name)
    assert cloud is not None and dropped == 0
    return cloud


def mesh_from_cloud(cloud: SplatCloud) -> Any:
    """The storage of Blender 4.5, made in any version."""
    b_mesh = bpy.data.meshes.new("mesh")
    b_mesh.vertices.add(cloud.splat_count)
    write_attribute(b_mesh, "position", "FLOAT_VECTOR", cloud.position)
    write_attribute(b_mesh, "scale", "FLOAT_VECTOR", cloud.scale)
    write_attribute(b_mesh, "rotation", "QUATERNION", cloud.rotation)
    write_attribute(b_mesh, BASE, "FLOAT_COLOR", np.concatenate([cloud.sh_dc, cloud.opacity[:, None]], axis=1))
    for index in range(cloud.sh_rest.shape[1]):
        write_attribute(b_mesh, f"radiance:sh_{index}", "FLOAT_VECTOR", cloud.sh_rest[:, index])
    return b_mesh


def delete_right_half(b_object: Any) -> None:
    """Geometry Nodes: delete points with x > 0."""
    b_tree = bpy.data.node_groups.new("Delete", "GeometryNodeTree")
    b_tree.interface.new_socket("Geometry", in_out="INPUT", socket_type="NodeSocketGeometry")
    b_tree.interface.new_socket("Geometry", in_out="OUTPUT", socket_type="NodeSocketGeometry")
    kinds = ("NodeGroupInput", "NodeGroupOutput", "GeometryNodeDeleteGeometry", "GeometryNodeInputPosition")
    b_in, b_out, b_delete, b_position = (b_tree.nodes.new(kind) for kind in kinds)
    b_separate, b_compare = b_tree.nodes.new("ShaderNodeSeparateXYZ"), b_tree.nodes.new("FunctionNodeCompare")
    b_compare.operation = "GREATER_THAN"
    for source, target in (
        (b_in.outputs[0], b_delete.inputs["Geometry"]),
        (b_position.outputs[0], b_separate.inputs[0]),
        (b_separate.outputs["X"], b_compare.inputs["A"]),
        (b_compare.outputs[0], b_delete.inputs["Selection"]),
        (b_delete.outputs[0], b_out.inputs[0]),
    ):
        b_tree.links.new(source, target)
    b_object.modifiers.new("Delete", "NODES").node_group = b_tree


@pytest.mark.parametrize("degree", [0, 1, 2, 3, 4])
def test_round_trip_keeps_every_bit(degree: int) -> None:
    cloud = random_cloud(degree=degree)
    b_data = datablock_from_cloud(cloud, "capture")
    assert is_capture(b_data)
    assert splat_count_of(b_data) == cloud.splat_count
    assert_same_cloud(read_back(b_data), cloud)


def test_extreme_values_keep_every_bit() -> None:
    cloud = random_cloud(4, 1)
    cloud.sh_dc[0] = (-1e30, 1e-42, -0.0)
    cloud.position[1] = (1e20, -1e-20, -0.0)
    cloud.scale[2] = (0.0, 1e-30, 1e10)
    assert_same_cloud(read_back(datablock_from_cloud(cloud, "capture")), cloud)


def test_storage_is_a_point_cloud_where_python_can_size_one() -> None:
    b_data = datablock_from_cloud(random_cloud(), "capture")
    types = {b_attribute.name: b_attribute.data_type for b_attribute in b_data.attributes}
    if bpy.app.version >= (5, 2, 0):
        assert isinstance(b_data, bpy.types.PointCloud)
        assert types[BASE] == "FLOAT4"
    else:
        assert isinstance(b_data, bpy.types.Mesh)
        assert types[BASE] == "FLOAT_COLOR"
    assert types["rotation"] == "QUATERNION"


def test_quaternions_are_stored_w_first() -> None:
    cloud = random_cloud(1, 0)
    half = np.float32(np.sqrt(0.5))
    cloud.rotation[0] = (half, 0, 0, half)  # a quarter turn about z
    b_object = add_capture(cloud)
    b_tree = bpy.data.node_groups.new("Turn", "GeometryNodeTree")
    b_tree.interface.new_socket("Geometry", in_out="INPUT", socket_type="NodeSocketGeometry")
    b_tree.interface.new_socket("Geometry", in_out="OUTPUT", socket_type="NodeSocketGeometry")
    kinds = ("NodeGroupInput", "NodeGroupOutput", "GeometryNodeSetPosition", "GeometryNodeInputNamedAttribute")
    b_in, b_out, b_set, b_named = (b_tree.nodes.new(kind) for kind in kinds)
    b_named.data_type = "QUATERNION"
    b_named.inputs["Name"].default_value = "rotation"
    b_turn = b_tree.nodes.new("FunctionNodeRotateVector")
    b_turn.inputs[0].default_value = (1.0, 0.0, 0.0)
    b_tree.links.new(b_in.outputs[0], b_set.inputs["Geometry"])
    b_tree.links.new(b_named.outputs["Attribute"], b_turn.inputs["Rotation"])
    b_tree.links.new(b_turn.outputs[0], b_set.inputs["Position"])
    b_tree.links.new(b_set.outputs[0], b_out.inputs[0])
    b_object.modifiers.new("Turn", "NODES").node_group = b_tree
    evaluated = b_object.evaluated_get(bpy.context.evaluated_depsgraph_get())
    np.testing.assert_allclose(read_back(evaluated.data).position[0], (0, 1, 0), atol=1e-6)


def test_a_mesh_is_read_in_every_version() -> None:
    cloud = random_cloud(degree=3)
    assert_same_cloud(read_back(mesh_from_cloud(cloud)), cloud)


@pytest.mark.parametrize("as_mesh", [False, True])
def test_geometry_nodes_delete_splats(as_mesh: bool) -> None:
    cloud = random_cloud(degree=1)
    b_object = bpy.data.objects.new("o", mesh_from_cloud(cloud) if as_mesh else datablock_from_cloud(cloud, "o"))
    bpy.context.scene.collection.objects.link(b_object)
    delete_right_half(b_object)
    left = cloud.position[:, 0] <= 0
    result = read_back(b_object.evaluated_get(bpy.context.evaluated_depsgraph_get()).data)
    assert 0 < result.splat_count < cloud.splat_count
    expected = SplatCloud(
        *(
            np.ascontiguousarray(getattr(cloud, a)[left])
            for a in ("position", "scale", "rotation", "opacity", "sh_dc", "sh_rest")
        )
    )
    order, expected_order = np.argsort(result.position[:, 0]), np.argsort(expected.position[:, 0])
    np.testing.assert_array_equal(result.sh_rest[order], expected.sh_rest[expected_order])
    np.testing.assert_array_equal(result.rotation[order], expected.rotation[expected_order])


def test_save_and_reload(tmp_path: Path) -> None:
    cloud = random_cloud(degree=3)
    add_capture(cloud, "Kept")
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "kept.blend"))
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    assert "Kept" not in bpy.data.objects
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "kept.blend"))
    assert_same_cloud(read_back(bpy.data.objects["Kept"].data), cloud)


@pytest.mark.parametrize("link", [False, True])
def test_append_and_link(tmp_path: Path, link: bool) -> None:
    cloud = random_cloud()
    add_capture(cloud, "Kept")
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "kept.blend"))
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    with bpy.data.libraries.load(str(tmp_path / "kept.blend"), link=link) as (source, target):
        target.objects = source.objects
    b_object = target.objects[0]
    assert (b_object.library is not None) == link
    assert_same_cloud(read_back(b_object.data), cloud)


def test_duplicates_share_or_copy_the_data() -> None:
    cloud = random_cloud()
    b_object = add_capture(cloud)
    b_linked, b_copy = b_object.copy(), b_object.copy()
    b_copy.data = b_object.data.copy()
    assert b_linked.data == b_object.data != b_copy.data
    assert_same_cloud(read_back(b_copy.data), cloud)


def test_key_follows_the_content() -> None:
    cloud = random_cloud(degree=1)
    b_data = datablock_from_cloud(cloud, "a")
    assert key_of(b_data, "a") == key_of(b_data.copy(), "b")
    cloud.opacity[7] = np.nextafter(cloud.opacity[7], np.float32(0))
    assert key_of(b_data, "a") != key_of(datablock_from_cloud(cloud, "c"), "c")


@pytest.mark.parametrize("name", ARRAY_NAMES)
def test_a_key_may_be_brought_up_to_date(name: str) -> None:
    """Where it is known what was written, only that is read: as if all were."""
    cloud = random_cloud(degree=1)
    b_data = datablock_from_cloud(cloud, "a")
    key = key_of(b_data, "a")
    getattr(cloud, name)[3] *= np.float32(0.5)
    write_arrays(b_data, cloud, {name})
    assert key_after(key, b_data, "a", {name}) == key_of(b_data, "a") != key
    assert key_after(key, b_data, "a", ()) == key


def test_an_ordinary_mesh_is_no_capture() -> None:
    assert not is_capture(bpy.data.meshes.new("mesh"))
    assert not is_capture(bpy.data.cameras.new("camera"))


@pytest.mark.parametrize("attribute", ["scale", "rotation"])
def test_a_missing_attribute_is_named(attribute: str) -> None:
    b_data = datablock_from_cloud(random_cloud(), "capture")
    b_data.attributes.remove(b_data.attributes[attribute])
    with pytest.raises(StippleError, match=rf"Statue: .*'{attribute}' is missing"):
        cloud_from_datablock(b_data, "Statue")


def test_a_wrong_type_is_named() -> None:
    b_data = datablock_from_cloud(random_cloud(), "capture")
    b_data.attributes.remove(b_data.attributes["scale"])
    b_data.attributes.new("scale", "FLOAT", "POINT")
    with pytest.raises(StippleError, match="'scale' is FLOAT on POINT; store it as FLOAT_VECTOR"):
        cloud_from_datablock(b_data, "Statue")


def test_an_incomplete_degree_is_named() -> None:
    b_data = datablock_from_cloud(random_cloud(degree=2), "capture")
    b_data.attributes.remove(b_data.attributes["radiance:sh_7"])
    with pytest.raises(StippleError, match="there are 7 attributes"):
        cloud_from_datablock(b_data, "Statue")


def test_values_broken_by_nodes_are_left_out_or_mended() -> None:
    cloud = random_cloud(6, 1)
    cloud.position[0, 1] = np.nan
    cloud.scale[1, 2] = -1
    cloud.rotation[2] = 0
    cloud.sh_rest[3, 0, 0] = np.inf
    cloud.rotation[4] *= 3
    cloud.opacity[5] = 1.5
    read, dropped = cloud_from_datablock(datablock_from_cloud(cloud, "capture"), "capture")
    assert read is not None
    assert (dropped, read.splat_count) == (4, 2)
    np.testing.assert_allclose(np.linalg.norm(read.rotation, axis=1), 1, atol=1e-6)
    assert read.opacity[1] == 1


def test_nothing_is_left_behind_when_writing_fails() -> None:
    broken = random_cloud()
    object.__setattr__(broken, "scale", broken.scale[:-1])
    with pytest.raises((RuntimeError, TypeError, ValueError)):
        datablock_from_cloud(broken, "broken")
    assert not [b_data for b_data in (*bpy.data.meshes, *bpy.data.pointclouds) if b_data.name == "broken"]
