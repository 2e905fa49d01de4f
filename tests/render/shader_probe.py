# SPDX-License-Identifier: GPL-3.0-or-later
"""The vertex shader's own functions, called for numbers that a test gives."""

from __future__ import annotations

from typing import Any

import numpy as np

from stipple.engine.rays.interface import Variant, complete_source
from stipple.engine.renderer import Renderer


def run_probe(
    rays: Renderer, main: str, content: tuple[str, ...], varyings: dict[str, int], asked: np.ndarray
) -> np.ndarray:
    """(N, K) int32: what `main`, GLSL with a main() of its own, writes to `varyings` for each row of `asked`.

    `content` is a row's layout and the names of its attributes, as moderngl has them; `varyings` gives each one's
    number of components, which follow each other in a row. Floats come as their bits.
    """
    host: Any = rays.raster().host
    context = host._context
    functions = complete_source("vertex", Variant(paged=True), per_sample=False).replace(
        "void main()", "void corner_main()"
    )
    row = sum(varyings.values())
    with context:
        host._target(1, 1, 1).use()  # nothing is drawn, but without one there is an error
        program = context.program(vertex_shader=functions + main, varyings=tuple(varyings))
        buffer, result = context.buffer(asked.tobytes()), context.buffer(reserve=4 * row * len(asked))
        array = context.vertex_array(program, [(buffer, *content)])
        array.transform(result, mode=context.POINTS, vertices=len(asked))
        return np.frombuffer(result.read(), np.int32).reshape(len(asked), row)
