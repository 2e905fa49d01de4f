# SPDX-License-Identifier: GPL-3.0-or-later
"""The world as the engine's background: a colour, an equirectangular image, or nothing with *Film > Transparent*.

What counts is what the camera sees at the world output: the color × strength of a Background (which World properties
show), or an Environment Texture linked to its color. `world_nodes` says which nodes are followed.
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
from .world_nodes import Notices, environment_from_world, origin_of, surface_of, value_of

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
    """What is behind the splats, and what of the world is not shown, in sentences, mostly empty.

    Nodes that are not evaluated give way to the world's viewport color, an image that is missing or of a kind that
    Stipple does not show to the color of the node it is linked to. No world, and nothing at its output, is black.
    """
    b_world = b_scene.world
    if b_scene.render.film_transparent:
        return None, ""
    if b_world is None or not _uses_nodes(b_world):
        return _encoded((0.0, 0.0, 0.0) if b_world is None else tuple(b_world.color)), ""
    notices: Notices = {}
    surface = surface_of(b_world.node_tree, notices)
    if surface is None:
        return _encoded(tuple(b_world.color) if notices else (0.0, 0.0, 0.0)), _joined(notices)
    b_color, strength = surface
    b_from, _ = origin_of(b_color)
    if b_from is not None and b_from.node.type == "TEX_ENVIRONMENT":
        environment = _environment(b_from.node, strength, notices)
        if environment is not None:
            return environment, _joined(notices)
        color = _own_color(b_color)
    else:
        color = value_of(b_color, notices)
    red, green, blue = (float(value) for value in color * strength)
    return _encoded((red, green, blue)), _joined(notices)


def _environment(b_texture: Any, strength: float, notices: Notices) -> Environment | None:
    problem = _problem_of(b_texture)
    if problem:
        notices[problem] = None
        return None
    image = images.image_of(b_texture.image, working_space())
    affine = environment_from_world(b_texture, notices)
    if notice := _colour_space_notice(b_texture.image):
        notices[notice] = None
    return Environment(image, _rows(affine), strength)


def _own_color(b_socket: Any) -> npt.NDArray[np.float64]:
    """An input's color without what is linked to it; an input for shaders has none."""
    return np.array(getattr(b_socket, "default_value", (0.0, 0.0, 0.0)), np.float64)[:3]


def _joined(notices: Notices) -> str:
    return " ".join(notices)


def working_space() -> str:
    """The scene-linear space of the open file, as engine.colour names it; before Blender 5 always Rec.709."""
    b_colour = getattr(bpy.data, "colorspace", None)
    return str(b_colour.working_space).removeprefix("Linear ") if b_colour else "Rec.709"


def _encoded(colour: tuple[float, float, float]) -> tuple[float, float, float]:
    red, green, blue, _ = display_from_scene_linear(np.array([[*colour, 1.0]]), working_space())[0]
    return float(red), float(green), float(blue)


def _uses_nodes(b_world: Any) -> bool:
    uses_nodes = bpy.app.version >= (5, 0, 0) or b_world.use_nodes  # from 5.0 on always, and asking is deprecated
    return uses_nodes and b_world.node_tree is not None


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
