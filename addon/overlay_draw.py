# SPDX-License-Identifier: GPL-3.0-or-later
"""Drawing into the 3D view's overlays with Blender's gpu module: colored points and the lines of bounding boxes.

Only usable in Blender's draw callbacks. The overlays' framebuffer holds color^2.2 of the display and the scene's depth.
"""

from __future__ import annotations

from functools import cache
from typing import Any

import gpu
import numpy as np
import numpy.typing as npt
from mathutils import Matrix, Vector

from .overlay_points import OverlayPoints

# A point is the pyramid that Blender draws for it, a little nearer: its tip lies one radius towards the eye, its four
# corners around the centre in a plane across the line of sight. `slope` is the view-space z of that plane per radius to
# the right and upwards.
POINTS_VERTEX = """
void main()
{
    vec4 at = vec4(place.xyz, 1.0);
    vec3 seen = vec3(dot(row_x, at), dot(row_y, at), dot(row_z, at));
    vec3 to_eye = clip_from_view[3][3] == 0.0 ? -normalize(seen) : vec3(0.0, 0.0, 1.0);
    float radius = place.w * look.x;
    vec2 slope = -vec2(to_eye.x * to_eye.z, to_eye.y) / max(length(to_eye.yz), 1e-6);
    pyramid = vec4(seen.z + NEARER * radius * to_eye.z, slope * radius, to_eye.z * radius);
    tint = colour;
    gl_Position = clip_from_view * vec4(seen + NEARER * radius * to_eye, 1.0);
    // Away from the middle of the picture, what lies across the line of sight is stretched by 1 / cos.
    float size = LARGER * radius * look.y / ((clip_from_view * vec4(seen, 1.0)).w * max(to_eye.z, 0.1));
    gl_PointSize = clamp(size, 1.0, 128.0);
}
""".replace("NEARER", "0.25").replace("LARGER", "2.1")
POINTS_FRAGMENT = """
void main()
{
    vec2 at = vec2(2.0, -2.0) * gl_PointCoord + vec2(-1.0, 1.0);
    float outwards = abs(at.x) + abs(at.y);
    if (outwards > 1.0) {
        discard;
    }
    vec4 seen = vec4(0.0, 0.0, pyramid.x + dot(pyramid.yz, at) + pyramid.w * (1.0 - outwards), 1.0);
    vec4 clip = clip_from_view * seen;
    gl_FragDepth = look.z * (0.5 * clip.z / clip.w + 0.5) + look.w;
    shown = tint;
}
"""
ROWS = ("row_x", "row_y", "row_z")
IN_SCENE, IN_FRONT, EMPTY = (1.0, 0.0), (0.01, 0.0), (0.0, 1.0)  # factor and offset of a point's depth
BOX_EDGES = ((0, 1), (1, 2), (2, 3), (3, 0), (4, 5), (5, 6), (6, 7), (7, 4), (0, 4), (1, 5), (2, 6), (3, 7))


def points_batch(points: OverlayPoints) -> Any:
    """The points on the graphics card; freed with the last reference."""
    layout = gpu.types.GPUVertFormat()
    layout.attr_add(id="place", comp_type="F32", len=4, fetch_mode="FLOAT")
    layout.attr_add(id="colour", comp_type="F32", len=4, fetch_mode="FLOAT")
    vertices = gpu.types.GPUVertBuf(layout, len(points.place))
    vertices.attr_fill("place", points.place)
    vertices.attr_fill("colour", points.colour)
    return gpu.types.GPUBatch(type="POINTS", buf=vertices)


def lines_batch(corners: npt.NDArray[np.float32]) -> Any:
    """The edges of boxes (B, 8, 3) whose corners come in the order of `Object.bound_box`."""
    ends = np.ascontiguousarray(corners[:, np.array(BOX_EDGES)].reshape(-1, 3), np.float32)
    layout = gpu.types.GPUVertFormat()
    layout.attr_add(id="pos", comp_type="F32", len=3, fetch_mode="FLOAT")
    vertices = gpu.types.GPUVertBuf(layout, len(ends))
    vertices.attr_fill("pos", ends)
    return gpu.types.GPUBatch(type="LINES", buf=vertices)


class OverlayPainter:
    """Draws with the matrices and the viewport that are set; a context manager that cleans up."""

    def __enter__(self) -> OverlayPainter:
        self._view = gpu.matrix.get_model_view_matrix()
        self._projection = gpu.matrix.get_projection_matrix()
        self._height_px = gpu.state.viewport_get()[3]
        gpu.state.blend_set("NONE")
        gpu.state.depth_test_set("LESS_EQUAL")
        gpu.state.depth_mask_set(True)
        gpu.state.program_point_size_set(True)
        return self

    def __exit__(self, *_: object) -> None:
        gpu.state.program_point_size_set(False)
        gpu.state.depth_mask_set(False)
        gpu.state.depth_test_set("NONE")

    def points(self, b_batch: Any, count: int, world_from_object: Matrix, in_front: bool) -> None:
        """The first `count` points, each a pyramid over Blender's own; `in_front` of everything else."""
        if in_front:  # where Blender has drawn the object, depth is 0
            gpu.state.depth_test_set("ALWAYS")
            gpu.state.color_mask_set(False, False, False, False)
            self._draw(b_batch, count, world_from_object, EMPTY)
            gpu.state.color_mask_set(True, True, True, True)
            gpu.state.depth_test_set("LESS_EQUAL")
        self._draw(b_batch, count, world_from_object, IN_FRONT if in_front else IN_SCENE)

    def _draw(self, b_batch: Any, count: int, world_from_object: Matrix, depth: tuple[float, float]) -> None:
        shader = _points_shader()
        shader.bind()
        view_from_object = self._view @ world_from_object
        for name, row in zip(ROWS, view_from_object, strict=False):
            shader.uniform_float(name, row)
        # As Blender scales the radii of its own points.
        radius = sum(abs(sum(row[:3])) for row in world_from_object[:3]) / 3
        shader.uniform_float("clip_from_view", self._projection)
        shader.uniform_float("look", (radius, self._projection[1][1] * self._height_px / 2, *depth))
        b_batch.draw_range(shader, elem_start=0, elem_count=count)

    def lines(self, b_batch: Any, colour: tuple[float, ...]) -> None:
        """Thin lines in world space."""
        shader = gpu.shader.from_builtin("UNIFORM_COLOR")
        shader.bind()
        shader.uniform_float("color", Vector((*colour[:3], 1.0)))
        b_batch.draw(shader)


@cache
def _points_shader() -> Any:
    info, interface = gpu.types.GPUShaderCreateInfo(), gpu.types.GPUStageInterfaceInfo("stipple_overlay")
    interface.flat("VEC4", "tint")
    interface.flat("VEC4", "pyramid")
    info.vertex_in(0, "VEC4", "place")
    info.vertex_in(1, "VEC4", "colour")
    info.push_constant("MAT4", "clip_from_view")  # 128 bytes together, which every graphics card has
    for name in (*ROWS, "look"):
        info.push_constant("VEC4", name)
    info.vertex_out(interface)
    info.fragment_out(0, "VEC4", "shown")
    info.depth_write("ANY")
    info.vertex_source(POINTS_VERTEX)
    info.fragment_source(POINTS_FRAGMENT)
    return gpu.shader.create_from_info(info)


def forget_shader() -> None:
    _points_shader.cache_clear()
