# SPDX-License-Identifier: GPL-3.0-or-later
"""Worlds for tests: a Background node, with an image around the scene or without."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import bpy
import numpy as np

from .captures import render


def add_world(color: tuple[float, float, float] = (0.0, 0.0, 0.0), strength: float = 1.0) -> Any:
    """The scene's new world: returns its Background node."""
    b_world = bpy.context.scene.world = bpy.data.worlds.new("World")
    if bpy.app.version < (5, 0, 0):
        b_world.use_nodes = True
    b_tree = b_world.node_tree
    b_tree.nodes.clear()
    b_output, b_background = b_tree.nodes.new("ShaderNodeOutputWorld"), b_tree.nodes.new("ShaderNodeBackground")
    b_tree.links.new(b_background.outputs[0], b_output.inputs["Surface"])
    b_background.inputs["Color"].default_value = (*color, 1.0)
    b_background.inputs["Strength"].default_value = strength
    return b_background


def add_environment(b_image: Any, strength: float = 1.0) -> Any:
    """A new world with the image around it, turned by a Mapping node: returns that."""
    b_background = add_world((0.2, 0.4, 0.6), strength)
    b_tree = b_background.id_data
    b_texture, b_mapping = b_tree.nodes.new("ShaderNodeTexEnvironment"), b_tree.nodes.new("ShaderNodeMapping")
    b_place = b_tree.nodes.new("ShaderNodeTexCoord")
    b_tree.links.new(b_place.outputs["Generated"], b_mapping.inputs["Vector"])
    b_tree.links.new(b_mapping.outputs[0], b_texture.inputs["Vector"])
    b_tree.links.new(b_texture.outputs["Color"], b_background.inputs["Color"])
    b_texture.image = b_image
    return b_mapping


def new_image(light: np.ndarray, name: str = "sky", float_buffer: bool = True) -> Any:
    """A generated image of (H, W, 3) values with rows from the top."""
    height, width = light.shape[:2]
    b_image = bpy.data.images.new(name, width, height, float_buffer=float_buffer)
    set_light(b_image, light)
    return b_image


def set_light(b_image: Any, light: np.ndarray) -> None:
    rgba = np.concatenate([light[::-1], np.ones((*light.shape[:2], 1))], axis=2)
    b_image.pixels.foreach_set(rgba.astype(np.float32).reshape(-1))
    b_image.update()


def save_exr(path: Path, light: np.ndarray) -> None:
    """Writes (H, W, 3) scene-linear values with rows from the top."""
    height, width = light.shape[:2]
    b_image = bpy.data.images.new("writer", width, height, float_buffer=True)
    b_image.colorspace_settings.name = "Non-Color"  # as they are; 4.5 encodes linear ones while saving
    set_light(b_image, light)
    b_image.filepath_raw, b_image.file_format = str(path), "OPEN_EXR"
    b_image.save()
    bpy.data.images.remove(b_image)


def load_linear(path: Path) -> Any:
    b_image = bpy.data.images.load(str(path))
    b_image.colorspace_settings.name = "Linear Rec.709"
    return b_image


def smooth_sky(brightest: float = 8.0, shape: tuple[int, int] = (64, 128)) -> np.ndarray:
    """Light without sharp edges, other in every direction, also across the seam."""
    rows, columns = shape
    around, down = np.meshgrid((np.arange(columns) + 0.5) / columns * 2 * np.pi, (np.arange(rows) + 0.5) / rows * np.pi)
    waves = [np.sin(around), np.sin(2 * around + 1), np.cos(around - 0.5)]
    return np.stack(
        [brightest * (0.55 + 0.4 * wave * np.sin(down) ** 2 + 0.05 * np.cos(down)) for wave in waves], axis=2
    )


def cycles_picture(path: Path) -> np.ndarray:
    """What Cycles sees through pixel centres of an empty scene."""
    b_scene = bpy.context.scene
    b_scene.render.engine = "CYCLES"
    b_scene.cycles.samples, b_scene.cycles.filter_width, b_scene.cycles.use_denoising = 1, 0.01, False
    b_scene.cycles.use_adaptive_sampling = False
    b_scene.cycles.pixel_filter_type = "BOX"
    picture = render(path)
    b_scene.render.engine = "STIPPLE"
    return picture
