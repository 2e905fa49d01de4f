# SPDX-License-Identifier: GPL-3.0-or-later
"""A viewport's matrices make the same camera as the objects they come from."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import bpy
import numpy as np
import pytest
from mathutils import Matrix

from stipple.addon.camera import OPENCV_FROM_BLENDER, camera_from_blender
from stipple.addon.view_camera import WHOLE, ViewportView, view_of
from stipple.addon.viewport import COARSEST
from stipple.engine.errors import StippleError
from stipple.engine.rays.support import make_frustum

from .captures import add_camera, use_stipple

pytestmark = pytest.mark.blender

POINTS = np.random.default_rng(3).uniform(-1.0, 1.0, (50, 3)) + np.array([0.0, 1.0, 0.0])


def rows(matrix: Any) -> tuple[tuple[float, ...], ...]:
    return tuple(tuple(float(value) for value in row) for row in matrix)


def posed_camera(kind: str) -> Any:
    b_scene = use_stipple(640, 360)
    b_camera = add_camera((0.4, -5.0, 0.7))
    b_camera.rotation_euler = (1.4, 0.1, 0.2)
    b_camera.data.type = kind
    b_camera.data.shift_x, b_camera.data.shift_y = 0.1, -0.05
    b_camera.data.ortho_scale = 4.0
    bpy.context.view_layer.update()
    assert b_scene.camera is b_camera
    return b_camera


def matrices(b_camera: Any, width: int, height: int) -> tuple[Any, Any]:
    """Window and view matrix as Blender itself computes them for this camera."""
    b_depsgraph = bpy.context.evaluated_depsgraph_get()
    return b_camera.calc_matrix_camera(b_depsgraph, x=width, y=height), b_camera.matrix_world.inverted()


def region(b_camera: Any, window: Any, view: Any, **space: Any) -> Any:
    """What view_of reads of a context, for a region that shows the camera: a window is what a background run lacks."""
    b_space = SimpleNamespace(camera=None, use_local_camera=False, use_render_border=False, **space)
    b_region_3d = SimpleNamespace(window_matrix=window, view_matrix=view, view_perspective="CAMERA")
    return SimpleNamespace(region=SimpleNamespace(width=640, height=360), region_data=b_region_3d, space_data=b_space)


@pytest.mark.parametrize("kind", ["PERSP", "ORTHO"])
@pytest.mark.parametrize("divider", [1, 2, 4])
def test_matrices_and_parameters_project_alike(kind: str, divider: int) -> None:
    b_camera = posed_camera(kind)
    window, view = matrices(b_camera, 640, 360)
    from_matrices = view_of(region(b_camera, window, view), bpy.context.scene).camera(divider)
    expected = camera_from_blender(b_camera, bpy.context.scene.render).project(POINTS)
    got = from_matrices.project(POINTS)
    assert from_matrices.width == 640 // divider
    np.testing.assert_allclose(got[:, :2] * divider, expected[:, :2], atol=2e-3)
    np.testing.assert_allclose(got[:, 2], expected[:, 2], atol=1e-5)
    assert from_matrices.near == pytest.approx(b_camera.data.clip_start, abs=1e-2)
    assert from_matrices.far == pytest.approx(b_camera.data.clip_end, rel=0.02)


def test_the_camera_view_has_the_final_render_s_own_matrix() -> None:
    b_camera = posed_camera("PERSP")
    window, view = matrices(b_camera, 640, 360)
    exact = view_of(region(b_camera, window, view), bpy.context.scene).camera()
    final = camera_from_blender(b_camera, bpy.context.scene.render)
    assert (exact.camera_from_world == final.camera_from_world).all()
    elsewhere = view_of(region(b_camera, window, Matrix.Translation((0, 0, 1)) @ view), bpy.context.scene).camera()
    assert abs(elsewhere.camera_from_world - final.camera_from_world).max() > 0.5


def test_a_panoramic_camera_is_refused_as_the_final_render_refuses_it() -> None:
    b_camera = posed_camera("PERSP")
    window, view = matrices(b_camera, 640, 360)
    b_camera.data.type = "PANO"
    context = region(b_camera, window, view)
    with pytest.raises(StippleError) as refused:
        camera_from_blender(b_camera, bpy.context.scene.render)
    with pytest.raises(StippleError, match="Camera: Stipple cannot render pano cameras") as shown:
        view_of(context, bpy.context.scene)
    assert str(shown.value) == str(refused.value)
    context.region_data.view_perspective = "PERSP"
    view_of(context, bpy.context.scene)  # from beside the camera its kind does not matter


def test_an_odd_size_is_covered_by_every_divider() -> None:
    b_camera = posed_camera("PERSP")
    window, view = matrices(b_camera, 641, 361)
    viewport = ViewportView(rows(window), rows(OPENCV_FROM_BLENDER @ np.array(view)[:3]), 641, 361)
    full = viewport.camera().project(POINTS)[:, :2] / [641, 361]
    quarter = viewport.camera(4)
    assert (quarter.width, quarter.height) == (161, 91)
    np.testing.assert_allclose(quarter.project(POINTS)[:, :2] / [161, 91], full, atol=1e-9)


def test_the_cameras_border_is_what_the_final_render_covers() -> None:
    b_camera = posed_camera("PERSP")
    b_render = bpy.context.scene.render
    b_render.use_border = True
    b_render.border_min_x, b_render.border_max_x = 0.25, 0.75
    b_render.border_min_y, b_render.border_max_y = 0.1, 0.6
    window, view = matrices(b_camera, 640, 360)
    viewport = view_of(region(b_camera, window, view), bpy.context.scene)
    assert viewport.border == pytest.approx((0.25, 0.1, 0.75, 0.6), abs=1e-5)
    x, y, width, height = viewport.camera().rendered_window
    assert abs(x - 160) <= 1 and abs(y - 144) <= 1 and abs(width - 320) <= 1 and abs(height - 180) <= 1


@pytest.mark.parametrize("border", [(-3.0, -3.0, -1.0, -1.0), (0.5, 0.5, 0.5, 0.5)])
def test_a_border_outside_shows_everything(border: tuple[float, float, float, float]) -> None:
    from stipple.addon.view_camera import _inside

    assert _inside(border) == WHOLE


def test_what_rays_cull_for_the_coarsest_picture_holds_the_borders_of_all() -> None:
    """A viewport sorts once, for its coarsest picture; that one's border is rounded to coarser pixels."""
    rng = np.random.default_rng(1)
    for _ in range(300):
        width, height = (int(size) for size in rng.integers(60, 2000, 2))
        left, bottom = rng.uniform(0.0, 0.6, 2)
        border = (left, bottom, *(np.array([left, bottom]) + rng.uniform(0.02, 0.4, 2)))
        clip = ((2.0, 0.0, 0.1, 0.0), (0.0, 3.0, -0.2, 0.0), (0.0, 0.0, -1.01, -0.2), (0.0, 0.0, -1.0, 0.0))
        view = ViewportView(clip, rows(np.eye(3, 4)), width, height, border)
        frustum = make_frustum(view.camera(COARSEST))
        for divider in (1, 2, 4):
            camera = view.camera(divider)
            x, y, across, down = camera.rendered_window
            for corner in ((x, y), (x + across, y + down)):
                slope = (np.array(corner) - (camera.cx, camera.cy)) / (camera.fx, camera.fy)
                for plane in (frustum.left, frustum.right, frustum.top, frustum.bottom):
                    assert np.dot(np.array(plane), (*slope, 1.0, 0.0)) > 0.0
