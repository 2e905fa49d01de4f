# SPDX-License-Identifier: GPL-3.0-or-later
"""The rays shaders on moderngl: a context without a window (EGL on Linux), on any driver with OpenGL 4.0."""

from __future__ import annotations

import sys
from typing import Any

import numpy as np

from ..errors import StippleError
from .host import Draw, FloatArray, batch_corners, batch_triangles
from .interface import ATTRIBUTES, CONSTANTS, TEXTURES, Texture, Variant, complete_source


class ModernGLDevice:
    """A `host.RasterHost`. Raises StippleError where no OpenGL context can be had."""

    def __init__(self) -> None:
        try:
            import moderngl
        except ImportError as error:
            raise StippleError("rays: moderngl is not installed; install it or choose the sorted method.") from error
        self._gl = moderngl
        options: dict[str, Any] = {"backend": "egl"} if sys.platform == "linux" else {}
        try:
            self._context = moderngl.create_context(standalone=True, require=400, **options)
        except Exception as error:
            raise StippleError(
                "rays: this machine gives no OpenGL 4.0 context (on Linux it takes libegl1 and a driver such as "
                "libgl1-mesa-dri); choose the sorted method instead."
            ) from error
        self.largest_texture = int(self._context.info["GL_MAX_TEXTURE_SIZE"])
        self.name = str(self._context.info["GL_RENDERER"])
        self._corners = self._context.buffer(batch_corners().tobytes())
        self._triangles = self._context.buffer(batch_triangles().tobytes())
        self._textures: dict[str, Any] = {}
        self._programs: dict[tuple[Variant, bool], tuple[Any, Any]] = {}
        self._targets: dict[tuple[int, int, int], Any] = {}

    def upload(self, texture: Texture, texels: FloatArray) -> None:
        """Replace a texture by (H, W, 4) float32 texels."""
        height, width, _ = texels.shape
        with self._context:  # the host program may have a context of its own
            held = self._textures.get(texture.name)
            if held is None or held.size != (width, height):
                if held is not None:
                    held.release()
                held = self._context.texture((width, height), 4, dtype="f4")
                held.filter = (self._gl.NEAREST, self._gl.NEAREST)
                self._textures[texture.name] = held
            held.write(np.ascontiguousarray(texels))

    def draw(self, draw: Draw) -> tuple[FloatArray, FloatArray]:
        """See `host.RasterHost.draw`."""
        with self._context:
            return self._draw(draw)

    def _draw(self, draw: Draw) -> tuple[FloatArray, FloatArray]:
        gl, context = self._gl, self._context
        array = self._program(draw)
        target = self._target(draw.width, draw.height, draw.multisamples)
        target.use()
        target.clear(0.0, 0.0, 0.0, 0.0, depth=1.0)
        if draw.variant.stochastic:
            context.enable_only(gl.DEPTH_TEST)
            context.depth_func = "<"
        else:
            context.enable_only(gl.BLEND)
            context.blend_func = (gl.ONE, gl.ONE_MINUS_SRC_ALPHA)
        for texture in TEXTURES:
            self._textures[texture.name].use(texture.slot)
        if draw.batch_count:
            array.render(gl.TRIANGLES, instances=draw.batch_count)
        if draw.multisamples > 1:
            single = self._target(draw.width, draw.height, 1)
            context.copy_framebuffer(single, target)
            target = single
        # The shader's rows run downwards and so does the picture: row 0 of OpenGL is its top.
        shape = (draw.height, draw.width, 4)
        colour, depth = (
            np.frombuffer(target.read(components=4, attachment=k, dtype="f4"), np.float32).reshape(shape)
            for k in range(2)
        )
        return colour, np.ascontiguousarray(depth[..., 0])

    def release(self) -> None:
        """Give everything back. The device cannot be used again."""
        self._context.release()

    def _program(self, draw: Draw) -> Any:
        """The vertex array with its program, made on first use, its constants set."""
        key = (draw.variant, draw.multisamples > 1)
        if key not in self._programs:
            sources = (complete_source(s, draw.variant, per_sample=key[1]) for s in ("vertex", "fragment"))
            vertex, fragment = sources
            program: Any = self._context.program(vertex_shader=vertex, fragment_shader=fragment)
            for texture in TEXTURES:
                if texture.name in program:  # a compiler drops what a variant does not read
                    program[texture.name].value = texture.slot
            content = [(self._corners, "3f", ATTRIBUTES[0].name)]
            self._programs[key] = (program, self._context.vertex_array(program, content, self._triangles))
        program, array = self._programs[key]
        for constant in CONSTANTS:
            if constant.name in program:
                program[constant.name].value = draw.constants[constant.name]
        return array

    def _target(self, width: int, height: int, multisamples: int) -> Any:
        key = (width, height, multisamples)
        if key not in self._targets:
            if multisamples > self._context.max_samples:
                raise StippleError(
                    f"rays: {self.name} has at most {self._context.max_samples} samples per pixel; ask for no more, "
                    "or for supersampling."
                )
            if len(self._targets) > 4:  # a viewport that is being resized leaves a trail
                for target in self._targets.values():
                    target.release()
                self._targets.clear()
            samples = 0 if multisamples == 1 else multisamples
            colours = [self._context.renderbuffer((width, height), 4, samples=samples, dtype="f4") for _ in range(2)]
            depth = self._context.depth_renderbuffer((width, height), samples=samples)
            self._targets[key] = self._context.framebuffer(colours, depth)
        return self._targets[key]
