# SPDX-License-Identifier: GPL-3.0-or-later
"""The rays shaders on Blender's gpu module: OpenGL, Vulkan or Metal, whatever Blender itself draws with.

Only usable where Blender has a graphics context: in the viewport's drawing, and in final renders of an engine with
`bl_use_gpu_context`. Textures, shaders and framebuffers belong to that context.
"""

from __future__ import annotations

from typing import Any

import gpu
import numpy as np

from ..engine.errors import StippleError
from ..engine.rays.host import Draw, FloatArray, batch_corners, batch_triangles
from ..engine.rays.interface import ATTRIBUTES, CONSTANTS, TEXTURES, Texture, Variant, create_info_calls, source
from .graphics import has_graphics

NO_CONTEXT = (
    "Rays needs a graphics context and Blender has none here (on Linux without a screen it takes libegl1 and a driver "
    "such as libgl1-mesa-dri); choose the method Sorted instead."
)
COLOUR_FORMAT = "RGBA32F"
DEPTH_FORMAT = "DEPTH_COMPONENT32F"


class BlenderRasterDevice:
    """An `engine.rays.host.RasterHost`. Raises StippleError where Blender has no graphics context."""

    def __init__(self) -> None:
        if not has_graphics():  # asking Blender for a context then would end the process
            raise StippleError(NO_CONTEXT)
        try:
            if hasattr(gpu, "init"):  # from 5.2; before, a context is there or not
                gpu.init()
            self.largest_texture = int(gpu.capabilities.max_texture_size_get())
        except (SystemError, RuntimeError) as error:
            raise StippleError(NO_CONTEXT) from error
        self._textures: dict[str, Any] = {}
        self._batches: dict[Variant, tuple[Any, Any]] = {}
        self._target: tuple[tuple[int, int], Any, list[Any]] | None = None

    def upload(self, texture: Texture, texels: FloatArray) -> None:
        """Replace a texture by (H, W, 4) float32 texels."""
        height, width, _ = texels.shape
        data = gpu.types.Buffer("FLOAT", width * height * 4, np.ascontiguousarray(texels, np.float32).reshape(-1))
        self._textures[texture.name] = gpu.types.GPUTexture((width, height), format=COLOUR_FORMAT, data=data)

    def draw(self, draw: Draw) -> tuple[FloatArray, FloatArray]:
        """See `host.RasterHost.draw`. Blender's textures have no multisamples: ask for supersampling instead."""
        if draw.multisamples > 1:
            raise StippleError("rays: Blender's graphics module has no multisamples; use supersampling instead.")
        framebuffer, colours = self._framebuffer(draw.width, draw.height)
        with framebuffer.bind():
            framebuffer.clear(color=(0.0, 0.0, 0.0, 0.0), depth=1.0)
            self._set_state(draw)
            try:
                if draw.batch_count:
                    self._render(draw)
            finally:
                gpu.state.blend_set("NONE")
                gpu.state.depth_test_set("NONE")
                gpu.state.depth_mask_set(False)
        colour, depth = (_texels(texture, draw.width, draw.height) for texture in colours)
        return colour, np.ascontiguousarray(depth[..., 0])

    def release(self) -> None:
        """Drop every texture, shader and framebuffer; Blender frees them with its context."""
        self._textures.clear()
        self._batches.clear()
        self._target = None

    def _set_state(self, draw: Draw) -> None:
        gpu.state.viewport_set(0, 0, draw.width, draw.height)
        gpu.state.blend_set("NONE" if draw.variant.stochastic else "ALPHA_PREMULT")
        gpu.state.depth_test_set("LESS" if draw.variant.stochastic else "NONE")
        gpu.state.depth_mask_set(draw.variant.stochastic)
        gpu.state.face_culling_set("NONE")

    def _render(self, draw: Draw) -> None:
        batch, shader = self._batch(draw.variant)
        shader.bind()
        for texture in TEXTURES:
            shader.uniform_sampler(texture.name, self._textures[texture.name])
        for constant in CONSTANTS:
            value = draw.constants[constant.name]
            set_value = shader.uniform_int if constant.glsl_type.startswith("i") else shader.uniform_float
            set_value(constant.name, value)
        batch.draw_instanced(shader, instance_start=0, instance_count=draw.batch_count)

    def _batch(self, variant: Variant) -> tuple[Any, Any]:
        """The batch of quads and the shader, compiled on first use."""
        if variant not in self._batches:
            info, interface = gpu.types.GPUShaderCreateInfo(), gpu.types.GPUStageInterfaceInfo("stipple_rays")
            info_calls, interface_calls = create_info_calls(variant)
            for method, *arguments in interface_calls:
                getattr(interface, method)(*arguments)
            for method, *arguments in info_calls:
                getattr(info, method)(*arguments)
            info.vertex_out(interface)
            info.vertex_source(source("vertex"))
            info.fragment_source(source("fragment"))
            shader = gpu.shader.create_from_info(info)
            layout = gpu.types.GPUVertFormat()
            layout.attr_add(id=ATTRIBUTES[0].name, comp_type="F32", len=3, fetch_mode="FLOAT")
            vertices, triangles = batch_corners(), batch_triangles()
            corners = gpu.types.GPUVertBuf(layout, len(vertices))
            corners.attr_fill(ATTRIBUTES[0].name, vertices.tolist())
            elements = gpu.types.GPUIndexBuf(type="TRIS", seq=triangles.tolist())
            self._batches[variant] = (gpu.types.GPUBatch(type="TRIS", buf=corners, elem=elements), shader)
        return self._batches[variant]

    def _framebuffer(self, width: int, height: int) -> tuple[Any, list[Any]]:
        if self._target is None or self._target[0] != (width, height):
            colours = [gpu.types.GPUTexture((width, height), format=COLOUR_FORMAT) for _ in range(2)]
            depth = gpu.types.GPUTexture((width, height), format=DEPTH_FORMAT)
            framebuffer = gpu.types.GPUFrameBuffer(depth_slot=depth, color_slots=tuple(colours))
            self._target = ((width, height), framebuffer, [*colours, depth])
        _, framebuffer, textures = self._target
        return framebuffer, textures[:2]


def _texels(texture: Any, width: int, height: int) -> FloatArray:
    """A texture's (H, W, 4) values; row 0 is the picture's top, because the shader's rows run downwards."""
    data = texture.read()
    data.dimensions = width * height * 4  # before 5.2 a buffer of several dimensions converts to wrong values
    return np.array(data, np.float32).reshape(height, width, 4)
