# SPDX-License-Identifier: GPL-3.0-or-later
"""Which nodes of a world are followed, as Cycles shows them, and what is said of the others."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest

from stipple.addon.world import background_of

from .captures import add_camera, render, use_stipple
from .worlds import add_environment, cycles_picture, new_image, smooth_sky

pytestmark = pytest.mark.blender


class World:
    """An environment around the scene, and its nodes by type."""

    def __init__(self) -> None:
        self.b_mapping = add_environment(new_image(smooth_sky()), 1.5)
        self.b_tree = self.b_mapping.id_data
        self.b_mapping.inputs["Rotation"].default_value = (0.4, -0.3, 1.1)
        by_type = {b_node.type: b_node for b_node in self.b_tree.nodes}
        self.b_background, self.b_texture = by_type["BACKGROUND"], by_type["TEX_ENVIRONMENT"]
        self.b_surface, self.b_place = by_type["OUTPUT_WORLD"].inputs["Surface"], by_type["TEX_COORD"]

    def add(self, kind: str, output: str | int, b_socket: Any, **inputs: Any) -> Any:
        """A node linked to an input; its own inputs get values or links."""
        b_node = self.b_tree.nodes.new(f"ShaderNode{kind}")
        for name, value in inputs.items():
            if isinstance(value, bpy.types.NodeSocket):
                self.b_tree.links.new(value, b_node.inputs[name])
            else:
                b_node.inputs[name].default_value = value
        self.b_tree.links.new(b_node.outputs[output], b_socket)
        return b_node

    def unlink(self, b_socket: Any) -> None:
        self.b_tree.links.remove(b_socket.links[0])


def nothing(world: World) -> None:
    world.unlink(world.b_surface)


def seen_by_the_camera(world: World) -> None:
    """Light from the image, and another color behind: a common set-up."""
    b_mix = world.add("MixShader", 0, world.b_surface)
    world.b_tree.links.new(world.b_background.outputs[0], b_mix.inputs[1])
    world.add("Emission", 0, b_mix.inputs[2], Color=(0.1, 0.5, 0.9, 1.0), Strength=2.0)
    world.add("LightPath", "Is Camera Ray", b_mix.inputs[0])


def one_side(world: World) -> None:
    b_mix = world.add("MixShader", 0, world.b_surface)
    b_mix.inputs[0].default_value = 0.0
    world.b_tree.links.new(world.b_background.outputs[0], b_mix.inputs[1])
    world.add("Emission", 0, b_mix.inputs[2])


def color_as_light(world: World) -> None:
    world.b_tree.links.new(world.b_texture.outputs[0], world.b_surface)


def strength(world: World) -> None:
    world.add("Value", 0, world.b_background.inputs["Strength"]).outputs[0].default_value = 0.7


def color(world: World) -> None:
    world.add("RGB", 0, world.b_background.inputs["Color"]).outputs[0].default_value = (0.3, 0.2, 0.9, 1.0)


def gray(world: World) -> None:
    world.add("Value", 0, world.b_background.inputs["Color"]).outputs[0].default_value = 0.4


def rotation(world: World) -> None:
    b_angles = world.add("CombineXYZ", 0, world.b_mapping.inputs["Rotation"], X=0.3, Y=0.2)
    world.add("Value", 0, b_angles.inputs["Z"]).outputs[0].default_value = 2.0


def object_place(world: World) -> None:
    """In the place of an object, which is moved, turned and scaled."""
    b_empty = bpy.data.objects.new("Turn", None)
    bpy.context.scene.collection.objects.link(b_empty)
    b_empty.location, b_empty.rotation_euler, b_empty.scale = (0.1, -0.2, 0.15), (0.5, 0.2, 1.0), (1.0, 0.8, 1.3)
    world.b_place.object = b_empty
    world.b_tree.links.new(world.b_place.outputs["Object"], world.b_mapping.inputs["Vector"])


def no_object_place(world: World) -> None:
    world.b_tree.links.new(world.b_place.outputs["Object"], world.b_mapping.inputs["Vector"])


def mute(name: str) -> Callable[[World], None]:
    def muted(world: World) -> None:
        getattr(world, name).mute = True

    muted.__name__ = f"mute{name.removeprefix('b')}"
    return muted


def mute_link(world: World) -> None:
    world.b_background.inputs["Color"].links[0].is_muted = True


def mute_gamma(world: World) -> None:
    b_gamma = world.add("Gamma", 0, world.b_background.inputs["Color"], Color=world.b_texture.outputs[0], Gamma=2.0)
    b_gamma.mute = True


FOLLOWED = (
    *(nothing, seen_by_the_camera, one_side, color_as_light, strength, color, gray, rotation),
    *(object_place, no_object_place, mute_link, mute_gamma),
    *(mute("b_background"), mute("b_texture"), mute("b_mapping")),
)


@pytest.mark.parametrize("change", FOLLOWED, ids=lambda change: change.__name__)
def test_what_is_followed_is_what_cycles_shows(tmp_path: Path, change: Callable[[World], None]) -> None:
    use_stipple(16, 12)
    b_camera = add_camera()
    b_camera.data.lens = 12.0
    b_camera.rotation_euler = (1.2, 0.3, 2.1)
    world = World()
    change(world)
    assert background_of(bpy.context.scene)[1] == ""
    ours, wanted = render(tmp_path / "ours.exr"), cycles_picture(tmp_path / "cycles.exr")
    np.testing.assert_allclose(ours[..., :3], wanted[..., :3], rtol=1e-3, atol=1e-5)  # it samples beside the centers


def said(change: Callable[[World], Any]) -> str:
    change(World())
    return background_of(bpy.context.scene)[1]


def test_shaders_that_are_not_evaluated_are_named() -> None:
    assert said(lambda world: world.add("AddShader", 0, world.b_surface)) == (
        "World: the node 'Add Shader' is not evaluated; link a Background to the World Output's Surface. "
        "The world's viewport color is shown instead."
    )
    assert "the node 'Mix Shader' is not" in said(lambda world: world.add("MixShader", 0, world.b_surface))
    assert "the node 'Group' is not" in said(shaded_by_a_group)


def shaded_by_a_group(world: World) -> None:
    b_group = world.b_tree.nodes.new("ShaderNodeGroup")
    b_group.node_tree = bpy.data.node_groups.new("Light", "ShaderNodeTree")
    b_group.node_tree.interface.new_socket("Shader", in_out="OUTPUT", socket_type="NodeSocketShader")
    world.b_tree.links.new(b_group.outputs[0], world.b_surface)


@pytest.mark.parametrize("output", ["Window", "Normal", "Camera"])
def test_coordinates_that_are_not_evaluated_are_named(output: str) -> None:
    def change(world: World) -> None:
        world.b_tree.links.new(world.b_place.outputs[output], world.b_mapping.inputs["Vector"])

    assert said(change) == f"World: Texture Coordinate > {output} is not evaluated; link Generated instead."


def test_values_that_are_not_evaluated_are_named() -> None:
    def change(world: World) -> None:
        world.add("Math", 0, world.b_background.inputs["Strength"])
        world.add("VectorMath", 0, world.b_mapping.inputs["Rotation"])

    assert said(change) == (
        "World: the node 'Math' is not evaluated; set the Background's Strength itself. "
        "World: the node 'Vector Math' is not evaluated; set the Mapping's Rotation itself."
    )
    sky = said(lambda world: world.add("TexSky", 0, world.b_background.inputs["Color"]))
    assert (
        sky == "World: the node 'Sky Texture' is not evaluated; link an Environment Texture to the Background's Color."
    )
