# SPDX-License-Identifier: GPL-3.0-or-later
"""Edit Splats: what is found through a camera, strokes of brushes, and the viewport's preview of them."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import bpy
import numpy as np
import pytest

from stipple.addon.camera import camera_from_blender
from stipple.addon.edit import drag as drags
from stipple.addon.edit import preview as previews
from stipple.addon.edit.operator import session_in
from stipple.addon.edit.visible import Picker
from stipple.addon.operators.edit_transform import STIPPLE_OT_resize
from stipple.addon.splat_data import cloud_from_datablock
from stipple.engine.edit.state import SELECTED
from stipple.engine.splats import SH_C0

from .captures import add_camera, random_cloud, use_stipple
from .editing import edited, every_byte, flags, positions, refused
from .test_looks import add_crop

pytestmark = pytest.mark.blender


@pytest.fixture
def b_object() -> Any:
    use_stipple(80, 60)
    add_camera()
    bpy.context.view_layer.update()
    return edited(random_cloud(count=400))


def pixels(b_object: Any) -> np.ndarray:
    """Where the camera sees the means (N, 2), from the bottom left, by its matrix alone."""
    b_camera = bpy.context.scene.camera
    in_camera = (positions(b_object) - np.array(b_camera.location)) @ np.array(b_camera.matrix_world)[:3, :3]
    focal = 80 * b_camera.data.lens / b_camera.data.sensor_width
    return in_camera[:, :2] / -in_camera[:, 2:] * focal + (40, 30)


def dab(location: Any, radius: float) -> dict[str, Any]:
    return {"name": "", "location": tuple(map(float, location)), "radius": radius}


def test_circle_box_and_lasso_find_what_the_camera_sees(b_object: Any) -> None:
    px = pixels(b_object)
    bpy.ops.stipple.select_circle(camera="Camera", x=30, y=40, radius=15)
    assert np.array_equal(flags(b_object, SELECTED), np.linalg.norm(px - (30, 40), axis=1) <= 15)
    bpy.ops.stipple.select_box(camera="Camera", xmin=20, xmax=45, ymin=10, ymax=50)
    inside = (px > (20, 10)).all(axis=1) & (px < (45, 50)).all(axis=1)
    assert np.array_equal(flags(b_object, SELECTED), inside) and 20 < inside.sum() < 380
    corners = [(20, 10), (45, 10), (45, 50), (20, 50)]
    path = [{"name": "", "loc": corner, "time": 0.0} for corner in corners]
    bpy.ops.stipple.select_lasso(camera="Camera", path=path, mode="XOR")
    assert not flags(b_object, SELECTED).any()
    with refused("draw a line"):
        bpy.ops.stipple.select_lasso(camera="Camera", path=path[:2])
    bpy.ops.stipple.select_depth(camera="Camera", near=3.5, far=4.5)
    assert np.array_equal(flags(b_object, SELECTED), np.abs(positions(b_object)[:, 1]) <= 0.5)


def test_what_a_crop_takes_away_is_neither_selected_nor_painted_over(b_object: Any) -> None:
    b_empty = bpy.data.objects.new("Crop", None)
    b_empty.location, b_empty.scale = (0.5, 0, 0), (0.5, 2, 2)
    bpy.context.scene.collection.objects.link(b_empty)
    add_crop(b_object, b_empty)
    bpy.context.view_layer.update()
    kept = positions(b_object)[:, 0] >= 0
    everything = [
        {"name": "", "loc": corner, "time": 0.0} for corner in ((-200, -200), (300, -200), (300, 300), (-200, 300))
    ]
    for select in (
        lambda: bpy.ops.stipple.select_circle(camera="Camera", x=40, y=30, radius=200),
        lambda: bpy.ops.stipple.select_circle(camera="Camera", x=40, y=30, radius=200, border=True),
        lambda: bpy.ops.stipple.select_box(camera="Camera", xmin=-200, xmax=300, ymin=-200, ymax=300),
        lambda: bpy.ops.stipple.select_lasso(camera="Camera", path=everything),
        lambda: bpy.ops.stipple.select_depth(camera="Camera", near=0, far=100),
    ):
        bpy.ops.stipple.select_all(action="DESELECT")
        select()
        assert np.array_equal(flags(b_object, SELECTED), kept)
    camera = camera_from_blender(bpy.context.scene.camera, bpy.context.scene.render)
    picker = Picker.of_session(bpy.context, session_in(bpy.context), camera)
    found = [picker.pick(x, 30) for x in range(0, 80, 2)]
    assert all(pick is None or kept[pick.splat] for pick in found) and any(found)


def test_a_stroke_of_circles_adds_and_takes_away(b_object: Any) -> None:
    px = pixels(b_object)
    near = [np.linalg.norm(px - place, axis=1) <= 12 for place in ((30, 30), (40, 30), (35, 30))]
    path = [{"name": "", "loc": (30, 30), "time": 0.0}, {"name": "", "loc": (40, 30), "time": 0.0}]
    bpy.ops.stipple.select_circle(camera="Camera", radius=12, path=[*path, {"name": "", "loc": (35, 30), "time": 1.0}])
    expected = (near[0] | near[1]) & ~near[2]
    assert np.array_equal(flags(b_object, SELECTED), expected) and expected.any()


def test_visible_only_leaves_out_what_is_behind() -> None:
    use_stipple(80, 60)
    add_camera()
    bpy.context.view_layer.update()
    cloud = random_cloud(count=4000, size=0.15)
    cloud.opacity[:] = 0.99
    b_object = edited(cloud)
    bpy.ops.stipple.select_box(camera="Camera", xmin=0, xmax=80, ymin=0, ymax=60, visible_only=True)
    depth, seen = positions(b_object)[:, 1], flags(b_object, SELECTED)
    middle = np.abs(positions(b_object)[:, [0, 2]]).max(axis=1) < 0.5
    assert seen[middle & (depth < -0.9)].mean() > 0.5 and seen[middle & (depth > 0.5)].mean() < 0.02


@pytest.mark.parametrize("method", ["SORTED", "RAYS"])
def test_the_picker_finds_the_splat_in_front(b_object: Any, method: str) -> None:
    bpy.context.scene.stipple.method = method
    camera = camera_from_blender(bpy.context.scene.camera, bpy.context.scene.render)
    picker = Picker.of_session(bpy.context, session_in(bpy.context), camera)
    found = [(place, picker.pick(*place)) for place in ((40.5, 30.5), (30.5, 25.5), (50.5, 38.5), (35.5, 40.5))]
    hits = [(place, hit) for place, hit in found if hit is not None]
    assert hits
    for place, hit in hits:
        assert np.linalg.norm(pixels(b_object)[hit.splat] - place) < 8
        off = abs(hit.position_world[1] - positions(b_object)[hit.splat, 1])
        assert off < 1e-4 if method == "SORTED" else off < 0.3  # on the splat, whose mean the ray may miss
    assert picker.pick(-1, 0) is None and picker.pick(0, 60) is None


@pytest.mark.parametrize("degree", [0, 3])
def test_paint_changes_colour_under_the_ball_only(degree: int) -> None:
    b_object = edited(random_cloud(degree=degree))
    before = cloud_from_datablock(b_object.data, "x")[0]
    under = np.linalg.norm(before.position - (-1, 0, 0), axis=1) < 1.0
    bpy.ops.stipple.paint(stroke=[dab((-1, 0, 0), 1.0)], color=(1, 0, 0), falloff="CONSTANT")
    after = cloud_from_datablock(b_object.data, "x")[0]
    assert np.array_equal(after.sh_dc[~under], before.sh_dc[~under])
    assert np.array_equal(after.sh_rest[~under], before.sh_rest[~under])
    assert np.allclose(0.5 + SH_C0 * after.sh_dc[under], (1, 0, 0), atol=2e-3)
    assert np.array_equal(after.position, before.position) and np.array_equal(after.opacity, before.opacity)
    bpy.ops.stipple.paint(stroke=[dab((0, 0, 0), 9.0)], mode="ERASE", falloff="CONSTANT")
    erased = cloud_from_datablock(b_object.data, "x")[0]
    assert np.array_equal(erased.sh_dc, before.sh_dc) and np.array_equal(erased.sh_rest, before.sh_rest)


@pytest.mark.parametrize(("paints", "erases"), [("RGB", "ERASE"), ("OPACITY", "ERASE_OPACITY")])
def test_an_eraser_says_why_there_is_nothing_to_erase(paints: str, erases: str) -> None:
    b_object = edited()
    stroke, before = [dab((-1, 0, 0), 1.0)], every_byte(b_object.data)
    with refused("Capture", "no paint to erase", "part of them now"):
        bpy.ops.stipple.paint(stroke=stroke, mode=erases)
    assert every_byte(b_object.data) == before
    bpy.ops.stipple.paint(stroke=stroke, mode=paints, opacity=0.3)
    assert bpy.ops.stipple.paint(stroke=[dab((9, 0, 0), 1.0)], mode=erases) == {"CANCELLED"}  # beside the paint
    bpy.ops.stipple.paint(stroke=stroke, mode=paints, opacity=0.4)
    bpy.ops.stipple.edit_mode_toggle()
    bpy.ops.stipple.edit_mode_toggle()
    with refused("Capture", "no paint to erase"):
        bpy.ops.stipple.paint(stroke=stroke, mode=erases)


def test_opacity_and_selected_only() -> None:
    b_object = edited()
    before = cloud_from_datablock(b_object.data, "x")[0]
    stroke = [dab((0, 0, 0), 9.0)]
    with refused("nothing is selected"):
        bpy.ops.stipple.paint(stroke=stroke, selected_only=True)
    bpy.ops.stipple.select_sphere(center=(-1, 0, 0), radius=1)
    chosen = flags(b_object, SELECTED)
    bpy.ops.stipple.paint(stroke=stroke, mode="OPACITY", opacity=0.25, falloff="CONSTANT", selected_only=True)
    after = cloud_from_datablock(b_object.data, "x")[0]
    assert np.allclose(after.opacity[chosen], 0.25) and np.array_equal(after.opacity[~chosen], before.opacity[~chosen])
    with refused("no dabs"):
        bpy.ops.stipple.paint()


def test_clone_copies_what_is_at_the_source() -> None:
    b_object = edited()
    before = positions(b_object)
    under = np.linalg.norm(before - (-0.5, 0, 0), axis=1) <= 0.6
    bpy.ops.stipple.clone(source=(-0.5, 0, 0), stroke=[dab((4, 0, 0), 0.6), dab((4, 0, 0), 0.3)])
    after = positions(b_object)
    assert len(after) == 200 + under.sum() and np.array_equal(after[:200], before)
    assert np.allclose(after[200:], before[under] + np.float32((4.5, 0, 0)), atol=1e-6)


def test_linked_splats_stay_in_their_island() -> None:
    cloud = random_cloud(count=600)
    cloud.position[300:] += np.float32([8, 0, 0])
    b_object = edited(cloud)
    bpy.ops.stipple.select_linked(splat=5, distance=3.0)
    chosen = flags(b_object, SELECTED)
    assert chosen[:300].sum() > 290 and not chosen[300:].any()
    with refused("no splat 600"):
        bpy.ops.stipple.select_linked(splat=600)


def test_similar_colours_are_selected() -> None:
    cloud = random_cloud()
    cloud.sh_dc[:50] = (np.float32([0.8, 0.1, 0.1]) - 0.5) / SH_C0
    cloud.sh_dc[50:] = (np.float32([0.1, 0.2, 0.9]) - 0.5) / SH_C0
    b_object = edited(cloud)
    bpy.ops.stipple.select_color(color=(0.8, 0.12, 0.1), threshold=0.05)
    assert np.array_equal(np.flatnonzero(flags(b_object, SELECTED)), np.arange(50))


def test_a_preview_is_shown_in_place_of_the_data_until_it_ends() -> None:
    from stipple.engine.edit.affine import translation
    from stipple.engine.edit.transform import TransformDrag

    b_object = edited()
    bpy.ops.stipple.select_all(action="SELECT")
    before, session = every_byte(b_object.data), session_in(bpy.context)
    b_evaluated = b_object.evaluated_get(bpy.context.evaluated_depsgraph_get())
    assert previews.preview_of(b_evaluated) is None
    drag, shown = TransformDrag(session.cloud), []
    for step in (1, 2):
        drag.update(translation((step, 0, 0)))
        previews.show_preview(b_object.data, session)
        preview = previews.preview_of(b_evaluated)
        assert np.allclose(preview.cloud.position, positions(b_object) + np.float32([step, 0, 0]), atol=1e-6)
        assert (preview.states.words == SELECTED).all()
        shown.append(previews.shown_previews())
    assert shown[0] != shown[1]
    drag.cancel()
    previews.end_preview(b_object.data)
    assert previews.preview_of(b_evaluated) is None and every_byte(b_object.data) == before
    bpy.ops.stipple.delete()
    assert np.allclose(session_in(bpy.context).snapshot().position, positions(b_object))


class ScaleDrag(drags.DragOperator):
    """*S* in a viewport that is only its camera, for the background has none."""

    kind, bl_label, bl_idname, value = "resize", "Scale Splats", "stipple.resize", (1.0, 1.0, 1.0)
    matrix, pivot_of, verb = STIPPLE_OT_resize.matrix, STIPPLE_OT_resize.pivot_of, STIPPLE_OT_resize.verb

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.said: list[str] = []
        camera = camera_from_blender(bpy.context.scene.camera, bpy.context.scene.render)
        monkeypatch.setattr(drags, "view_of", lambda *_: SimpleNamespace(camera=lambda: camera))
        silent = SimpleNamespace(header_text_set=lambda text: None, status_text_set=lambda text: None)
        manager = SimpleNamespace(
            windows=(), modal_handler_add=lambda operator: None, progress_begin=lambda *_: None,
            progress_update=lambda *_: None, progress_end=lambda: None,
        )  # fmt: skip
        self.context = SimpleNamespace(
            object=bpy.context.object, mode="OBJECT", scene=bpy.context.scene, area=silent, workspace=silent,
            region=silent, region_data=silent, window_manager=manager,
        )  # fmt: skip
        assert self.invoke(self.context, self.event("S")) == {"RUNNING_MODAL"}

    @staticmethod
    def event(key: str) -> Any:
        return SimpleNamespace(type=key, value="PRESS", ctrl=False, shift=False, mouse_region_x=70, mouse_region_y=50)

    def report(self, kind: set[str], text: str) -> None:
        self.said.append(text)

    def press(self, *keys: str) -> set[str]:
        for key in keys:
            result = self.modal(self.context, self.event(key))
            if result != {"RUNNING_MODAL"}:
                break
        return result


def test_a_number_may_begin_with_zero(b_object: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    bpy.ops.stipple.select_all(action="SELECT")
    before = positions(b_object)
    drag = ScaleDrag(monkeypatch)
    assert drag.press("ZERO") == {"RUNNING_MODAL"}
    assert np.array_equal(session_in(bpy.context).snapshot().position, before)  # the last map that splats can follow
    assert drag.press("PERIOD", "FIVE", "RET") == {"FINISHED"} and not drag.said
    middle = before.mean(axis=0, dtype=np.float64)
    assert np.allclose(positions(b_object), middle + (before - middle) / 2, atol=1e-6)


def test_a_scale_of_zero_is_refused_when_it_is_confirmed(b_object: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    bpy.ops.stipple.select_all(action="SELECT")
    before = every_byte(b_object.data)
    drag = ScaleDrag(monkeypatch)
    assert drag.press("TWO", "BACK_SPACE", "X", "ZERO") == {"RUNNING_MODAL"}
    assert drag.press("RET") == {"CANCELLED"}
    assert drag.said == ["Capture: the transform flattens the capture; give every axis a scale."]
    assert every_byte(b_object.data) == before and previews.preview_of(b_object) is None
    drag = ScaleDrag(monkeypatch)
    assert drag.press("ZERO", "ESC") == {"CANCELLED"} and not drag.said  # nobody asked for it
