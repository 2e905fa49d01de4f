# SPDX-License-Identifier: GPL-3.0-or-later
"""Captures through Geometry Nodes and modifiers: what deletes, moves and instances points does so to splats."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest

from stipple.addon.residency import CloudCache
from stipple.addon.splat_data import write_cloud
from stipple.addon.sync import scene_from_depsgraph
from stipple.engine.scene import Scene
from stipple.engine.splats import ARRAY_NAMES, SplatCloud

from .captures import add_camera, assert_same_cloud, random_cloud, render, use_stipple
from .test_looks import add_crop
from .test_sync import add_empty

pytestmark = pytest.mark.blender

HAS_POINT_CLOUDS = "resize" in bpy.types.PointCloud.bl_rna.functions
KINDS = ["MESH", *(["POINTCLOUD"] if HAS_POINT_CLOUDS else [])]


def add_capture_of(kind: str, cloud: SplatCloud, name: str = "Capture") -> Any:
    if kind == "MESH":
        b_data = bpy.data.meshes.new(name)
        b_data.vertices.add(cloud.splat_count)
    else:
        b_data = bpy.data.pointclouds.new(name)
        b_data.resize(cloud.splat_count)
    write_cloud(b_data, cloud)
    b_object = bpy.data.objects.new(name, b_data)
    bpy.context.scene.collection.objects.link(b_object)
    return b_object


class Nodes:
    """A node group as a modifier of an object, built from left to right."""

    def __init__(self, b_object: Any) -> None:
        self.b_tree = bpy.data.node_groups.new("Nodes", "GeometryNodeTree")
        for way in ("INPUT", "OUTPUT"):
            self.b_tree.interface.new_socket("Geometry", in_out=way, socket_type="NodeSocketGeometry")
        self.geometry = self.add("NodeGroupInput").outputs[0]
        self.b_output = self.add("NodeGroupOutput")
        self.b_modifier = b_object.modifiers.new("Nodes", "NODES")
        self.b_modifier.node_group = self.b_tree

    def add(self, kind: str, inputs: dict[str, Any] | None = None, **properties: Any) -> Any:
        """A node; inputs by name are linked where they are sockets, else set."""
        b_node = self.b_tree.nodes.new(kind)
        for name, value in properties.items():
            setattr(b_node, name, value)
        for name, value in (inputs or {}).items():
            b_socket = next(s for s in b_node.inputs if s.name == name and s.enabled)
            if isinstance(value, bpy.types.NodeSocket):
                self.b_tree.links.new(value, b_socket)
            else:
                b_socket.default_value = value
        return b_node

    def attribute(self, name: str, data_type: str) -> Any:
        b_node = self.add("GeometryNodeInputNamedAttribute", data_type=data_type)
        b_node.inputs["Name"].default_value = name
        return next(s for s in b_node.outputs if s.name == "Attribute" and s.enabled)

    def above(self, value: Any, limit: float) -> Any:
        """A field: the x of a vector, or a float, above the limit."""
        if value.type == "VECTOR":
            value = self.add("ShaderNodeSeparateXYZ", {"Vector": value}).outputs["X"]
        b_node = self.add("FunctionNodeCompare", {"A": value, "B": limit}, data_type="FLOAT", operation="GREATER_THAN")
        return b_node.outputs["Result"]

    def end(self, geometry: Any) -> None:
        self.b_tree.links.new(geometry, self.b_output.inputs[0])


def synced() -> Scene:
    scene, warnings = scene_from_depsgraph(bpy.context.evaluated_depsgraph_get(), CloudCache())
    assert warnings == ()
    return scene


def subset(cloud: SplatCloud, mask: np.ndarray) -> SplatCloud:
    return SplatCloud(**{name: np.ascontiguousarray(getattr(cloud, name)[mask]) for name in ARRAY_NAMES})


@pytest.mark.parametrize("kind", KINDS)
def test_nodes_delete_splats_in_a_box(kind: str) -> None:
    """By position; what remains keeps every bit, spherical harmonics too."""
    cloud = random_cloud(300, degree=3)
    nodes = Nodes(add_capture_of(kind, cloud))
    b_position = nodes.add("GeometryNodeInputPosition").outputs[0]
    b_node = nodes.add(
        "GeometryNodeDeleteGeometry",
        {"Geometry": nodes.geometry, "Selection": nodes.above(b_position, 0.25)},
        domain="POINT",
    )
    nodes.end(b_node.outputs[0])
    (instance,) = synced().instances
    keep = cloud.position[:, 0] <= 0.25
    assert 50 < keep.sum() < 250
    assert_same_cloud(instance.cloud, subset(cloud, keep))


@pytest.mark.parametrize("kind", KINDS)
def test_nodes_delete_splats_by_an_attribute(kind: str) -> None:
    """By their size, which is an attribute like any other."""
    cloud = random_cloud(300, degree=1)
    nodes = Nodes(add_capture_of(kind, cloud))
    selection = nodes.above(nodes.attribute("scale", "FLOAT_VECTOR"), 0.05)
    b_node = nodes.add(
        "GeometryNodeDeleteGeometry", {"Geometry": nodes.geometry, "Selection": selection}, domain="POINT"
    )
    nodes.end(b_node.outputs[0])
    (instance,) = synced().instances
    keep = cloud.scale[:, 0] <= np.float32(0.05)
    assert 50 < keep.sum() < 250
    assert_same_cloud(instance.cloud, subset(cloud, keep))


@pytest.mark.parametrize("kind", KINDS)
def test_nodes_move_splats_and_animate_it(kind: str, tmp_path: Path) -> None:
    """Half of them go up with the frame, and the picture with them."""
    b_scene = use_stipple()
    b_scene.render.film_transparent = True
    add_camera()
    cloud = random_cloud(300, degree=2, size=0.02)
    nodes = Nodes(add_capture_of(kind, cloud))
    b_position = nodes.add("GeometryNodeInputPosition").outputs[0]
    b_node = nodes.add(
        "GeometryNodeSetPosition", {"Geometry": nodes.geometry, "Selection": nodes.above(b_position, 0.0)}
    )
    nodes.end(b_node.outputs[0])
    b_offset = b_node.inputs["Offset"]
    for frame, height in ((1, 0.0), (11, 5.0)):
        b_offset.default_value = (0.0, 0.0, height)
        b_offset.keyframe_insert("default_value", frame=frame)
    right = []
    for frame, height in ((1, 0.0), (11, 5.0)):
        b_scene.frame_set(frame)
        (instance,) = synced().instances
        wanted = cloud.position + np.where(cloud.position[:, :1] > 0, np.array([[0, 0, height]], np.float32), 0)
        np.testing.assert_allclose(instance.cloud.position, wanted, atol=1e-6)
        for name in set(ARRAY_NAMES) - {"position"}:
            np.testing.assert_array_equal(getattr(instance.cloud, name), getattr(cloud, name))
        right.append(render(tmp_path / f"{frame}.exr")[:, 36:, 3].max())
    assert right[0] > 0.5 and right[1] == 0.0


@pytest.mark.parametrize("kind", KINDS)
def test_nodes_instance_a_capture_with_its_look(kind: str) -> None:
    """Instance on Points of the capture as an object: one cloud, each place, the capture's look and its crop."""
    cloud = random_cloud(100, degree=1)
    b_capture = add_capture_of(kind, cloud, "Tree")
    b_capture.stipple.exposure, b_capture.hide_render = 1.5, False
    add_crop(b_capture, add_empty("Volume", scale=(0.5, 0.5, 0.5)), "SPHERE")
    b_places = bpy.data.meshes.new("Places")
    b_places.from_pydata([(10.0, 0, 0), (0, 20.0, 0), (0, 0, 30.0)], [], [])
    b_garden = bpy.data.objects.new("Garden", b_places)
    bpy.context.scene.collection.objects.link(b_garden)
    b_garden.stipple.exposure = -9.0
    nodes = Nodes(b_garden)
    b_info = nodes.add("GeometryNodeObjectInfo", {"Object": b_capture, "As Instance": True})
    b_node = nodes.add(
        "GeometryNodeInstanceOnPoints", {"Points": nodes.geometry, "Instance": b_info.outputs["Geometry"]}
    )
    nodes.end(b_node.outputs[0])
    scene = synced()
    assert len(scene.instances) == 4 and len({id(i.cloud) for i in scene.instances}) == 1
    assert {i.look.exposure for i in scene.instances} == {1.5}
    for instance in scene.instances:  # each is cropped about its own middle
        centre = np.array(instance.look.crops[0].world_from_crop)[:, 3]
        np.testing.assert_allclose(centre, instance.world_from_object[:, 3], atol=1e-5)
    places = sorted(tuple(np.round(i.world_from_object[:, 3])) for i in scene.instances)
    assert places == [(0, 0, 0), (0, 0, 30), (0, 20, 0), (10, 0, 0)]


@pytest.mark.parametrize("kind", KINDS)
def test_nodes_instance_the_geometry_of_a_capture(kind: str) -> None:
    """The capture's own geometry on points, without an object in between: the object's look."""
    cloud = random_cloud(50, degree=1)
    b_object = add_capture_of(kind, cloud)
    b_object.stipple.size = 2.0
    nodes = Nodes(b_object)
    b_line = nodes.add("GeometryNodeMeshLine", {"Count": 3, "Offset": (0.0, 0.0, 5.0)})
    b_node = nodes.add("GeometryNodeInstanceOnPoints", {"Points": b_line.outputs[0], "Instance": nodes.geometry})
    nodes.end(b_node.outputs[0])
    scene = synced()
    found = [i for i in scene.instances if i.cloud.splat_count == 50]
    assert sorted(round(float(i.world_from_object[2, 3])) for i in found) == [0, 5, 10]
    assert {i.look.size for i in found} == {2.0}
    for instance in found:
        assert_same_cloud(instance.cloud, cloud)


def test_modifiers_of_meshes_mask_and_displace_splats() -> None:
    cloud = random_cloud(300, degree=1)
    b_object = add_capture_of("MESH", cloud)
    b_group = b_object.vertex_groups.new(name="Kept")
    kept = np.flatnonzero(cloud.position[:, 2] > 0)
    b_group.add(kept.tolist(), 1.0, "REPLACE")
    b_object.modifiers.new("Mask", "MASK").vertex_group = "Kept"
    b_displace = b_object.modifiers.new("Displace", "DISPLACE")
    b_displace.direction, b_displace.strength, b_displace.mid_level = "Z", 3.0, 0.0
    (instance,) = synced().instances
    assert instance.cloud.splat_count == len(kept)
    np.testing.assert_allclose(instance.cloud.position, cloud.position[kept] + (0, 0, 3), atol=1e-6)
    np.testing.assert_array_equal(instance.cloud.sh_rest, cloud.sh_rest[kept])
