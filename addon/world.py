# SPDX-License-Identifier: GPL-3.0-or-later
"""The world as the engine's background: a colour, an equirectangular image, or nothing with *Film > Transparent*.

What counts is the Background node at the world output (the one World properties show): its color × strength, or an
Environment Texture linked to its color, turned by a Mapping node. Other shader nodes are not evaluated.
"""

from __future__ import annotations

import os
import zlib
from typing import Any

import bpy
import numpy as np
import numpy.typing as npt

from ..engine.colour import display_from_scene_linear, linear_from_srgb, working_space_from_rec709
from ..engine.scene import Background, Environment, EnvironmentImage

LARGEST_LIGHT = 65504.0  # of a half float; what an infinite pixel of an OpenEXR file was before it overflowed
IMAGES_KEPT = 2
STILL_SOURCES = ("FILE", "GENERATED")
LINEAR_SPACES = ("Linear Rec.709", "Linear", "Non-Color", "Raw")

Key = tuple[object, ...]


class WorldImages:
    """Environment images by what they were read from: the same image gives the same `EnvironmentImage` object.

    An image that Python or a brush changed tells nobody. So its pixels are compared after `look_again` only, which
    hosts call where Blender says that something changed.
    """

    def __init__(self) -> None:
        self._known: dict[Key, tuple[Key, EnvironmentImage]] = {}  # by what is cheap to ask; newest last
        self._trusted: set[Key] = set()

    def look_again(self) -> None:
        self._trusted.clear()

    def image_of(self, b_image: Any, space: str) -> EnvironmentImage:
        """The image's light; reads its pixels where they are new."""
        key = (
            *(getattr(b_image, name) for name in ("session_uid", "filepath", "source", "is_float", "alpha_mode")),
            *b_image.size,
            b_image.colorspace_settings.name,
            space,
        )
        known = self._known.pop(key, None)
        if known is None or key not in self._trusted:
            content = _content(b_image)
            if known is None or known[0] != content:
                known = (content, EnvironmentImage(_light(b_image, space), b_image.name))
            self._trusted.add(key)
        self._known[key] = known
        while len(self._known) > IMAGES_KEPT:
            self._known.pop(next(iter(self._known)))
        return known[1]

    def free(self) -> None:
        self._known.clear()
        self._trusted.clear()


images = WorldImages()


def background_of(b_scene: Any) -> tuple[Background, str]:
    """What is behind the splats, and a sentence on what of the world is not shown, mostly empty.

    A world without a Background node gives its viewport color, no world gives black. An image that is missing or of a
    kind that Stipple does not show gives the Background node's own color.
    """
    if b_scene.render.film_transparent:
        return None, ""
    b_node = _background_node(b_scene.world)
    if b_node is None:
        return _encoded((0.0, 0.0, 0.0) if b_scene.world is None else tuple(b_scene.world.color)), ""
    strength = b_node.inputs["Strength"].default_value
    b_texture = _linked(b_node.inputs["Color"])
    notice = ""
    if b_texture is not None and b_texture.type == "TEX_ENVIRONMENT":
        notice = _problem_of(b_texture)
        if not notice:
            image = images.image_of(b_texture.image, working_space())
            affine, notice = _environment_from_world(b_texture)
            return Environment(image, _rows(affine), strength), notice or _colour_space_notice(b_texture.image)
    elif b_texture is not None:
        name = b_texture.name
        notice = f"World: the node {name!r} is not evaluated; link an Environment Texture to the Background's Color."
    red, green, blue, _ = b_node.inputs["Color"].default_value
    return _encoded((red * strength, green * strength, blue * strength)), notice


def working_space() -> str:
    """The scene-linear space of the open file, as engine.colour names it; before Blender 5 always Rec.709."""
    b_colour = getattr(bpy.data, "colorspace", None)
    return str(b_colour.working_space).removeprefix("Linear ") if b_colour else "Rec.709"


def _encoded(colour: tuple[float, float, float]) -> tuple[float, float, float]:
    red, green, blue, _ = display_from_scene_linear(np.array([[*colour, 1.0]]), working_space())[0]
    return float(red), float(green), float(blue)


def _background_node(b_world: Any) -> Any:
    if b_world is None:
        return None
    uses_nodes = bpy.app.version >= (5, 0, 0) or b_world.use_nodes  # from 5.0 on always, and asking is deprecated
    b_tree = b_world.node_tree if uses_nodes else None
    b_output = b_tree.get_output_node("EEVEE") if b_tree else None
    b_node = _linked(b_output.inputs["Surface"]) if b_output else None
    return b_node if b_node is not None and b_node.type == "BACKGROUND" else None


def _linked(b_socket: Any) -> Any:
    """The node at the other end of a socket's link, through reroutes; None without one."""
    while b_socket.is_linked:
        b_node = b_socket.links[0].from_node
        if b_node.type != "REROUTE":
            return b_node
        b_socket = b_node.inputs[0]
    return None


def _problem_of(b_texture: Any) -> str:
    """Why the texture's image cannot be shown; empty where it can."""
    b_image = b_texture.image
    if b_image is None:
        return "World: the Environment Texture has no image; choose one. Its color is shown instead."
    if b_image.source not in STILL_SOURCES:
        return (
            f"World: {b_image.name} is {b_image.source.lower()}; choose a single image in the Environment Texture. "
            "The color is shown instead."
        )
    if b_texture.projection != "EQUIRECTANGULAR":
        return "World: set the Environment Texture's projection to Equirectangular. The color is shown instead."
    if not all(b_image.size):
        path = bpy.path.abspath(b_image.filepath, library=b_image.library)
        return (
            f"World: the image {b_image.name} is missing or cannot be read ({path or 'no file'}); choose it again "
            "in the Environment Texture. The color is shown instead."
        )
    return ""


def _environment_from_world(b_texture: Any) -> tuple[npt.NDArray[np.float64], str]:
    """(3, 4): what the texture's Vector makes of a direction, and a sentence where that is not evaluated."""
    affine = np.eye(3, 4)
    b_node = _linked(b_texture.inputs["Vector"])
    if b_node is not None and b_node.type == "MAPPING":
        affine = _mapping(b_node)
        b_node = _linked(b_node.inputs["Vector"])
        if b_node is None:
            return np.hstack([np.zeros((3, 3)), affine[:, 3:]]), ""  # as Blender: one vector for all directions
    if b_node is not None and b_node.type != "TEX_COORD":
        return affine, f"World: the node {b_node.name!r} is not evaluated; link Texture Coordinate > Generated instead."
    return affine, ""


def _mapping(b_node: Any) -> npt.NDArray[np.float64]:
    """A Mapping node's own values as (3, 4); those linked to it are not evaluated."""
    turn = np.array(b_node.inputs["Rotation"].default_value.to_matrix(), np.float64)
    scale = np.array(b_node.inputs["Scale"].default_value, np.float64)
    b_location = b_node.inputs.get("Location")
    place = np.zeros(3) if b_location is None else np.array(b_location.default_value, np.float64)
    if b_node.vector_type == "POINT":
        return np.column_stack([turn * scale, place])
    inverse = np.divide(1.0, scale, out=np.zeros(3), where=scale != 0)  # as Blender divides
    if b_node.vector_type == "TEXTURE":
        linear = inverse[:, None] * turn.T
        return np.column_stack([linear, -linear @ place])
    return np.column_stack([turn * (inverse if b_node.vector_type == "NORMAL" else scale), np.zeros(3)])


def _content(b_image: Any) -> Key:
    """What tells whether an image's pixels changed; those of a file on a disk are not looked at."""
    if b_image.source == "FILE" and b_image.packed_file is None and not b_image.is_dirty:
        try:
            status = os.stat(bpy.path.abspath(b_image.filepath, library=b_image.library))
            return (status.st_mtime_ns, status.st_size)
        except OSError:
            pass  # deleted after Blender read it
    return (zlib.crc32(_values(b_image)),)


def _values(b_image: Any) -> npt.NDArray[np.float32]:
    """(H, W, channels) as Blender has them, rows from the bottom."""
    width, height = b_image.size
    values = np.empty(width * height * b_image.channels, np.float32)
    b_image.pixels.foreach_get(values)
    return values.reshape(height, width, b_image.channels)


def _light(b_image: Any, space: str) -> npt.NDArray[np.float32]:
    """(H, W, 3) scene-linear Rec.709 light, rows from the top, all finite.

    Float images are linear light of the working space as Blender loaded them; byte images are as stored.
    """
    values = _values(b_image)
    light = values[..., :3] if values.shape[2] >= 3 else np.repeat(values[..., :1], 3, axis=2)
    name = b_image.colorspace_settings.name
    if not b_image.is_float and name not in LINEAR_SPACES:
        light = linear_from_srgb(light)
    if values.shape[2] == 4 and not b_image.is_float and b_image.alpha_mode == "STRAIGHT":
        light = light * values[..., 3:]
    if space != "Rec.709" and b_image.is_float:
        light = light @ np.linalg.inv(working_space_from_rec709(space)).T.astype(np.float32)
    finite = np.nan_to_num(light[::-1], nan=0.0, posinf=LARGEST_LIGHT, neginf=0.0)
    return np.ascontiguousarray(finite, np.float32)


def _colour_space_notice(b_image: Any) -> str:
    name = b_image.colorspace_settings.name
    if b_image.is_float or name == "sRGB" or name in LINEAR_SPACES:
        return ""
    return f"World: {b_image.name} is read as sRGB; its color space {name} is known for float images only."


def _rows(matrix: npt.NDArray[np.float64]) -> tuple[tuple[float, ...], ...]:
    return tuple(tuple(float(value) for value in row) for row in matrix)
