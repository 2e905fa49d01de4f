# SPDX-License-Identifier: GPL-3.0-or-later
"""Geometry Nodes modifiers for tests."""

from __future__ import annotations

from typing import Any

import bpy


def node_tree(b_object: Any, kind: str) -> Any:
    """Gives an object a modifier of one `kind`.

    - "transform": moves its points along x; "deleted": leaves half of them; "instances": ten of its geometry in a row;
      "realized": their points.
    """
    b_tree = bpy.data.node_groups.new(kind, "GeometryNodeTree")
    for direction in ("INPUT", "OUTPUT"):
        b_tree.interface.new_socket("Geometry", in_out=direction, socket_type="NodeSocketGeometry")
    b_in, b_out = b_tree.nodes.new("NodeGroupInput"), b_tree.nodes.new("NodeGroupOutput")
    if kind == "transform":
        b_node = b_tree.nodes.new("GeometryNodeTransform")
        b_node.inputs["Translation"].default_value = (1, 0, 0)
        b_tree.links.new(b_in.outputs[0], b_node.inputs[0])
    elif kind == "deleted":
        b_node, b_index = b_tree.nodes.new("GeometryNodeDeleteGeometry"), b_tree.nodes.new("GeometryNodeInputIndex")
        b_odd = b_tree.nodes.new("ShaderNodeMath")
        b_odd.operation, b_odd.inputs[1].default_value = "MODULO", 2.0
        b_tree.links.new(b_index.outputs[0], b_odd.inputs[0])
        b_tree.links.new(b_odd.outputs[0], b_node.inputs["Selection"])
        b_tree.links.new(b_in.outputs[0], b_node.inputs[0])
    else:
        b_node, b_line = b_tree.nodes.new("GeometryNodeInstanceOnPoints"), b_tree.nodes.new("GeometryNodeMeshLine")
        b_tree.links.new(b_line.outputs[0], b_node.inputs["Points"])
        b_tree.links.new(b_in.outputs[0], b_node.inputs["Instance"])
    if kind == "realized":
        b_realize = b_tree.nodes.new("GeometryNodeRealizeInstances")
        b_tree.links.new(b_node.outputs[0], b_realize.inputs[0])
        b_node = b_realize
    b_tree.links.new(b_node.outputs[0], b_out.inputs[0])
    b_object.modifiers.new(kind, "NODES").node_group = b_tree
    return b_tree
