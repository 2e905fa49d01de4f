# SPDX-License-Identifier: GPL-3.0-or-later
"""What a world's nodes say, as far as they are followed; what is not is named in `notices`.

Followed as Blender does: reroutes, muted nodes and links; Background and Emission, and of a Mix Shader the side that
the camera sees; Value, RGB and Combine XYZ nodes; one Mapping node and the coordinates that are a direction.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
from mathutils import Euler

FloatArray = npt.NDArray[np.float64]
Notices = dict[str, None]
LIGHTS = ("BACKGROUND", "EMISSION")
CONSTANTS = ("VALUE", "RGB", "COMBXYZ")


def origin_of(b_socket: Any) -> tuple[Any, Any]:
    """The output that feeds an input, and None without one; and the input whose own value counts then."""
    b_value = b_socket
    while b_socket.is_linked and not b_socket.links[0].is_muted:
        b_from = b_socket.links[0].from_socket
        b_node = b_from.node
        if b_node.type == "REROUTE":
            b_socket = b_node.inputs[0]
        elif b_node.mute:
            b_inner = next((b_link for b_link in b_node.internal_links if b_link.to_socket == b_from), None)
            if b_inner is None:
                break
            b_socket = b_value = b_inner.from_socket
        else:
            return b_from, b_value
    return None, b_value


def surface_of(b_tree: Any, notices: Notices) -> tuple[Any, float] | None:
    """The input that holds the color behind everything, and a strength.

    None where there is nothing, which is black, and where it is not evaluated, with a notice.
    """
    b_output = b_tree.get_output_node("EEVEE")
    if b_output is None:
        return None
    b_surface = b_output.inputs["Surface"]
    b_from, _ = origin_of(b_surface)
    while b_from is not None and b_from.node.type == "MIX_SHADER" and (side := _seen_side(b_from.node)) is not None:
        b_surface = b_from.node.inputs[1 + side]
        b_from, _ = origin_of(b_surface)
    if b_from is None:
        return None
    b_node = b_from.node
    if b_node.type in LIGHTS:
        return b_node.inputs["Color"], float(value_of(b_node.inputs["Strength"], notices, 1)[0])
    if b_from.type != "SHADER":
        return b_surface, 1.0  # Blender takes a color for light
    notices[
        f"World: the node {b_node.name!r} is not evaluated; link a Background to the World Output's Surface. The "
        "world's viewport color is shown instead."
    ] = None
    return None


def _seen_side(b_mix: Any) -> int | None:
    """Which shader of a mix the camera sees whole: 0, 1, or None where it sees both or it cannot be told."""
    b_from, _ = origin_of(b_mix.inputs[0])
    if b_from is not None and b_from.node.type == "LIGHT_PATH":
        return 1 if b_from.identifier == "Is Camera Ray" else None
    unknown: Notices = {}
    share = value_of(b_mix.inputs[0], unknown, 1)[0]
    return int(share) if not unknown and share in (0.0, 1.0) else None


def value_of(b_socket: Any, notices: Notices, size: int = 3) -> FloatArray:
    """The (size,) values of an input that is set or linked to constants, else its own and a notice."""
    b_from, b_value = origin_of(b_socket)
    if b_from is not None:
        values = _constant(b_from.node, notices)
        if values is not None and len(values) in (1, size):
            return np.broadcast_to(values, size)
        place = f"the {b_socket.node.name}'s {b_socket.name}"
        is_color = b_socket.type in ("RGBA", "SHADER")
        advice = f"link an Environment Texture to {place}" if is_color else f"set {place} itself"
        notices[f"World: the node {b_from.node.name!r} is not evaluated; {advice}."] = None
        b_value = b_socket
    values = np.atleast_1d(np.array(getattr(b_value, "default_value", 0.0), np.float64))[:3]
    return np.broadcast_to(values[:size] if len(values) > 1 else values, size)


def _constant(b_node: Any, notices: Notices) -> FloatArray | None:
    if b_node.type not in CONSTANTS:
        return None
    if b_node.type == "COMBXYZ":
        return np.concatenate([value_of(b_socket, notices, 1) for b_socket in b_node.inputs])
    return np.atleast_1d(np.array(b_node.outputs[0].default_value, np.float64))[:3]


def environment_from_world(b_texture: Any, notices: Notices) -> FloatArray:
    """(3, 4): what an Environment Texture's Vector makes of a direction."""
    affine, b_vector = np.eye(3, 4), b_texture.inputs["Vector"]
    b_from, b_value = origin_of(b_vector)
    if b_from is not None and b_from.node.type == "MAPPING":
        affine = _mapping(b_from.node, notices)
        b_from, b_value = origin_of(b_from.node.inputs["Vector"])
    if b_from is not None:
        return _with(affine, _coordinates(b_from, notices))
    if b_value == b_vector:
        return affine
    vector = np.array(b_value.default_value, np.float64)  # as Blender: one for all directions
    return _with(affine, np.column_stack([np.zeros((3, 3)), vector]))


def _coordinates(b_from: Any, notices: Notices) -> FloatArray:
    """(3, 4): an output's coordinates from a direction."""
    b_node = b_from.node
    if b_node.type != "TEX_COORD":
        notices[f"World: the node {b_node.name!r} is not evaluated; link Texture Coordinate > Generated instead."] = (
            None
        )
    elif b_from.identifier == "Object" and b_node.object is not None:
        return np.linalg.pinv(np.array(b_node.object.matrix_world, np.float64))[:3]
    elif b_from.identifier not in ("Generated", "Object"):
        notices[f"World: Texture Coordinate > {b_from.name} is not evaluated; link Generated instead."] = None
    return np.eye(3, 4)


def _mapping(b_node: Any, notices: Notices) -> FloatArray:
    """A Mapping node as (3, 4)."""
    angles, scale = (value_of(b_node.inputs[name], notices) for name in ("Rotation", "Scale"))
    turn = np.array(Euler(angles).to_matrix(), np.float64)
    place = value_of(b_node.inputs["Location"], notices) if "Location" in b_node.inputs else np.zeros(3)
    if b_node.vector_type == "POINT":
        return np.column_stack([turn * scale, place])
    inverse = np.divide(1.0, scale, out=np.zeros(3), where=scale != 0)  # as Blender divides
    if b_node.vector_type == "TEXTURE":
        linear = inverse[:, None] * turn.T
        return np.column_stack([linear, -linear @ place])
    return np.column_stack([turn * (inverse if b_node.vector_type == "NORMAL" else scale), np.zeros(3)])


def _with(affine: FloatArray, before: FloatArray) -> FloatArray:
    """(3, 4): `before`, then `affine`."""
    return affine @ np.vstack([before, (0.0, 0.0, 0.0, 1.0)])
