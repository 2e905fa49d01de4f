# SPDX-License-Identifier: GPL-3.0-or-later
"""A finished picture on the screen: a texture in scene-linear light, drawn where it belongs in the region.

Blender's viewport buffer holds scene-linear light; Blender applies the scene's view transform to it afterwards, the
same one that a saved render gets.
"""

from __future__ import annotations

from typing import Any

import gpu
import numpy as np

from .shown_picture import ShownPicture

LARGEST_HALF = np.float32(65504)


class Display:
    """The texture of one viewport; used only in Blender's draw callbacks, where its GPU context is current."""

    def __init__(self) -> None:
        self._shown: ShownPicture | None = None
        self._texture: Any = None

    def draw(self, b_engine: Any, b_scene: Any, picture: ShownPicture, size: tuple[int, int]) -> None:
        """Draws the picture over its part of a region of `size` [px]; a smaller picture is stretched smoothly."""
        if picture is not self._shown:
            self._texture, self._shown = _texture(picture), picture
        left, bottom, right, top = picture.place
        x0, x1, y0, y1 = left * size[0], right * size[0], bottom * size[1], top * size[1]
        gpu.state.blend_set("ALPHA_PREMULT")
        b_engine.bind_display_space_shader(b_scene)
        try:
            self._draw_rectangle(x0, y0, x1, y1)
        finally:
            b_engine.unbind_display_space_shader()
            gpu.state.blend_set("NONE")

    def _draw_rectangle(self, x0: float, y0: float, x1: float, y1: float) -> None:
        shader = gpu.shader.from_builtin("IMAGE")
        layout = gpu.types.GPUVertFormat()
        layout.attr_add(id="pos", comp_type="F32", len=2, fetch_mode="FLOAT")
        layout.attr_add(id="texCoord", comp_type="F32", len=2, fetch_mode="FLOAT")
        vertices = gpu.types.GPUVertBuf(layout, 4)
        vertices.attr_fill("pos", ((x0, y0), (x1, y0), (x0, y1), (x1, y1)))
        vertices.attr_fill("texCoord", ((0, 0), (1, 0), (0, 1), (1, 1)))
        batch = gpu.types.GPUBatch(type="TRI_STRIP", buf=vertices)
        shader.bind()
        shader.uniform_sampler("image", self._texture)
        batch.draw(shader)


def _texture(picture: ShownPicture) -> Any:
    height, width = picture.rgba.shape[:2]
    light = np.minimum(picture.rgba, LARGEST_HALF)  # a brighter sky would be infinite there
    values = gpu.types.Buffer("FLOAT", light.size, light.reshape(-1))
    b_texture = gpu.types.GPUTexture((width, height), format="RGBA16F", data=values)
    if hasattr(b_texture, "filter_mode"):
        b_texture.filter_mode(picture.divider > 1)
    return b_texture
