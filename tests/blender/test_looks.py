# SPDX-License-Identifier: GPL-3.0-or-later
"""`object.stipple`: what reaches the engine, live, animated, instanced and overridden; crops and their objects."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest

from stipple.addon import residency, sync
from stipple.addon.residency import CloudCache, EvaluatedClouds
from stipple.addon.splat_data import write_attribute
from stipple.engine.look import Look
from stipple.engine.scene import Instance, Scene

from .captures import add_camera, add_capture, random_cloud, render, use_stipple
from .test_sync import add_empty

pytestmark = pytest.mark.blender

SETTINGS = {
    "exposure": (0.5, "exposure", 0.5),
    "gain": ((1.5, 1.0, 0.25), "gain", (1.5, 1.0, 0.25)),
    "saturation": (0.5, "saturation", 0.5),
    "tint": ((0.25, 0.5, 1.0), "tint", (0.25, 0.5, 1.0)),
    "tint_factor": (0.75, "tint_factor", 0.75),
    "opacity": (0.5, "opacity", 0.5),
    "size": (2.0, "size", 2.0),
    "sh_degree": (1, "sh_degree", 1),
    "antialiased": ("ON", "antialiased", True),
    "display": ("POINTS", "display", "points"),
    "point_size": (5.0, "point_px", 5.0),
    "least_opacity": (0.25, "least_opacity", 0.25),
}


def read() -> tuple[Scene, tuple[str, ...]]:
    return sync.scene_from_depsgraph(bpy.context.evaluated_depsgraph_get(), CloudCache())


def looks() -> list[Look]:
    scene, warnings = read()
    assert warnings == ()
    return [instance.look for instance in scene.instances]


def assert_alike(left: Look, right: Look) -> None:
    """Equal but for the last digit of single precision."""
    for name, value in vars(right).items():
        assert getattr(left, name) == pytest.approx(value), name


def add_crop(b_object: Any, b_volume: Any, shape: str = "BOX", keep: str = "INSIDE") -> Any:
    b_crop = b_object.stipple.crops.add()
    b_crop.object, b_crop.shape, b_crop.keep = b_volume, shape, keep
    return b_crop


def test_untouched_captures_have_the_engines_own_look() -> None:
    add_capture(random_cloud())
    (look,) = looks()
    assert_alike(look, Look())
    assert look.light_matrix() is None


@pytest.mark.parametrize("name", SETTINGS)
def test_every_setting_arrives_at_once(name: str) -> None:
    """Without a hand on the depsgraph: setting the value is enough."""
    b_object = add_capture(random_cloud())
    bpy.context.evaluated_depsgraph_get()
    value, field, wanted = SETTINGS[name]
    setattr(b_object.stipple, name, value)
    (look,) = looks()
    assert getattr(look, field) == wanted
    assert_alike(replace(look, **{field: getattr(Look(), field)}), Look())


def test_limits_are_the_engines() -> None:
    """Whatever Blender lets through, the engine takes."""
    b_stipple = add_capture(random_cloud()).stipple
    for prop in b_stipple.bl_rna.properties:
        if prop.type in ("FLOAT", "INT") and not prop.is_readonly and prop.identifier != "active_crop":
            for limit in (-1e9, 1e9):
                value = int(limit) if prop.type == "INT" else limit
                setattr(b_stipple, prop.identifier, (value,) * prop.array_length if prop.is_array else value)
                looks()


def test_drivers_and_keyframes_animate_a_look() -> None:
    b_object, b_scene = add_capture(random_cloud()), bpy.context.scene
    for frame, value in ((1, -1.0), (11, 1.0)):
        b_object.stipple.exposure = value
        b_object.keyframe_insert("stipple.exposure", frame=frame)
    b_driver = b_object.driver_add("stipple.saturation").driver
    b_driver.expression = "frame / 10"
    for frame, exposure in ((1, -1.0), (6, 0.0), (11, 1.0)):
        b_scene.frame_set(frame)
        (look,) = looks()
        assert (look.exposure, look.saturation) == pytest.approx((exposure, frame / 10), abs=1e-6)


@pytest.mark.parametrize("method", ["SORTED", "POINTS"])
def test_an_animated_exposure_brightens_the_frames(tmp_path: Path, method: str) -> None:
    """Rendered as an animation: a stop from frame to frame, in a wall that fills the picture."""
    b_scene = use_stipple(method=method)
    b_scene.stipple.alpha_max = 1.0
    wall = random_cloud(40, degree=0, size=0.0)
    wall.scale[:], wall.opacity[:], wall.sh_dc[:], wall.position[:, 1] = 50.0, 1.0, (0.1, -0.3, -0.6), 0.0
    b_object = add_capture(wall)
    add_camera()
    for frame in (1, 2, 3):
        b_object.stipple.exposure = frame - 2.0
        b_object.keyframe_insert("stipple.exposure", frame=frame)
    light = []
    for frame in (1, 2, 3):
        b_scene.frame_set(frame)
        light.append(render(tmp_path / f"{frame}.exr")[..., :3].mean(axis=(0, 1)))
    np.testing.assert_allclose(light[1] / light[0], 2.0, rtol=5e-3)
    np.testing.assert_allclose(light[2] / light[1], 2.0, rtol=5e-3)


def test_every_capture_has_its_own_look() -> None:
    for index in range(3):
        add_capture(random_cloud(), f"Capture {index}").stipple.exposure = index
    assert [look.exposure for look in looks()] == [0.0, 1.0, 2.0]


def test_instances_have_the_look_of_what_is_instanced() -> None:
    b_object = add_capture(random_cloud())
    b_collection = bpy.data.collections.new("Set")
    bpy.context.scene.collection.objects.unlink(b_object)
    b_collection.objects.link(b_object)
    b_object.location, b_object.stipple.exposure = (1.0, 0.0, 0.0), 2.0
    b_volume = add_empty("Volume", location=(1.0, 0.5, 0.0), scale=(0.5, 0.5, 0.5))
    add_crop(b_object, b_volume)
    for index in range(2):
        b_empty = add_empty(f"Copy {index}", instance_type="COLLECTION", instance_collection=b_collection)
        b_empty.location, b_empty.stipple.exposure = (0.0, 0.0, 10.0 * index), -7.0  # the empty's own says nothing
    found = looks()
    assert [look.exposure for look in found] == [2.0, 2.0]
    places = sorted(np.array(look.crops[0].world_from_crop)[:, 3].tolist() for look in found)
    np.testing.assert_allclose(places, [[1.0, 0.5, 0.0], [1.0, 0.5, 10.0]], atol=1e-6)


def test_a_look_is_not_read_as_geometry_and_uploads_nothing(tmp_path: Path) -> None:
    """The viewport's own way: a changed look reaches it with the same clouds, none read again, though Blender calls
    them changed; an edit of the splats is read."""
    use_stipple()
    b_object, b_empty = add_capture(random_cloud()), add_empty("Volume", scale=(0.5, 0.5, 0.5))
    add_crop(b_object, b_empty)
    b_depsgraph = bpy.context.evaluated_depsgraph_get()
    cache = CloudCache()
    known, changes, reads = EvaluatedClouds(cache), [], []
    original = cache.cloud_of
    cache.cloud_of = lambda b_data, name: (reads.append(name), original(b_data, name))[1]  # type: ignore[method-assign]

    def instances() -> tuple[Instance, ...]:
        told = set(changes)
        changes.clear()
        with known.reading(told):
            return sync._instances(
                b_depsgraph,
                lambda b_instance, b: known.cloud_of(
                    b.data, b.name, [b.original.data.session_uid, b.original.session_uid]
                ),
            )[0]

    def note(_scene: Any, b_updated: Any) -> None:
        changes.extend(sync.changed_geometry(b_updated))

    bpy.app.handlers.depsgraph_update_post.append(note)
    try:
        first = instances()
        seen = [first]
        for change in (
            lambda: setattr(b_object.stipple, "exposure", 1.0),
            lambda: setattr(b_object.stipple.crops[0], "shape", "SPHERE"),
            lambda: setattr(b_empty, "location", (0.1, 0.0, 0.0)),
        ):
            change()
            bpy.context.view_layer.update()
            seen.append(instances())
    finally:
        bpy.app.handlers.depsgraph_update_post.remove(note)
    assert reads == ["Capture"]
    assert all(each[0].cloud is first[0].cloud for each in seen)
    assert len({each[0].look for each in seen}) == 4
    write_attribute(b_object.data, "position", "FLOAT_VECTOR", 2 * first[0].cloud.position)
    b_object.data.update_tag()
    b_object.stipple.exposure = 2.0  # both at once
    bpy.context.view_layer.update()
    changes.append(b_object.session_uid)
    assert instances()[0].cloud is not first[0].cloud and reads == ["Capture", "Capture"]


def test_a_changed_look_renders_with_the_uploaded_cloud(tmp_path: Path) -> None:
    use_stipple()
    b_object, b_empty = add_capture(random_cloud()), add_empty("Volume", scale=(0.5, 5.0, 5.0))
    add_camera()
    pictures = [render(tmp_path / "a.exr")]
    renderer = residency.renderer_for("cpu")
    held = {id(cloud) for cloud, _ in renderer._clouds.values()}
    devices = {id(device) for _, device in renderer._clouds.values()}
    b_object.stipple.gain = (0.2, 1.0, 2.0)
    pictures.append(render(tmp_path / "b.exr"))
    add_crop(b_object, b_empty)
    pictures.append(render(tmp_path / "c.exr"))
    b_object.stipple.display = "ELLIPSOIDS"
    pictures.append(render(tmp_path / "d.exr"))
    assert {id(cloud) for cloud, _ in renderer._clouds.values()} == held
    assert {id(device) for _, device in renderer._clouds.values()} == devices
    for before, after in pairwise(pictures):
        assert np.abs(before - after).max() > 0.1


def test_a_look_survives_saving_and_duplication(tmp_path: Path) -> None:
    b_object, b_empty = add_capture(random_cloud(), "Statue"), add_empty("Volume")
    b_object.stipple.exposure = 1.5
    add_crop(b_object, b_empty, "SPHERE", "OUTSIDE")
    b_copy = b_object.copy()
    bpy.context.scene.collection.objects.link(b_copy)
    assert looks()[0] == looks()[1]
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "file.blend"))
    before = looks()
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "file.blend"))
    assert looks() == before


def override_in_new_file(folder: Path) -> Any:
    """Saves the open file as a library; an override of its object Statue in a new file."""
    bpy.ops.wm.save_as_mainfile(filepath=str(folder / "library.blend"))
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    with bpy.data.libraries.load(str(folder / "library.blend"), link=True) as (_, into):
        into.objects = ["Statue"]
    bpy.context.scene.collection.objects.link(into.objects[0])
    return into.objects[0].override_create(remap_local_usages=True)


def test_library_overrides_change_a_linked_capture(tmp_path: Path) -> None:
    b_object, b_empty = add_capture(random_cloud(), "Statue"), add_empty("Volume", scale=(0.5, 0.5, 0.5))
    b_object.stipple.exposure = 1.0
    add_crop(b_object, b_empty)
    b_override = override_in_new_file(tmp_path)
    b_override.stipple.exposure = -2.0
    b_override.stipple.size = 1.5
    b_more = b_override.stipple.crops.add()
    b_more.object, b_more.keep = add_empty("Local", scale=(0.1, 0.1, 0.1)), "OUTSIDE"
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "shot.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "shot.blend"))
    scene, _ = read()
    (look,) = (instance.look for instance in scene.instances)
    assert (look.exposure, look.size) == (-2.0, 1.5)
    assert [c.keep for c in bpy.data.objects["Statue"].stipple.crops] == ["INSIDE", "OUTSIDE"]


def test_overrides_last_where_the_library_has_no_settings(tmp_path: Path) -> None:
    """Blender would note that all settings differ, which it cannot apply, and lose them at this or the next reading."""
    add_capture(random_cloud(), "Statue")
    b_override = override_in_new_file(tmp_path)
    b_override.stipple.exposure, b_override.stipple.display = 1.5, "ELLIPSOIDS"
    b_override.stipple.crops.add().shape = "SPHERE"
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "shot.blend"))
    for _ in range(3):
        bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "shot.blend"))
        b_stipple = next(b_object for b_object in bpy.data.objects if b_object.override_library).stipple
        assert (b_stipple.exposure, b_stipple.display) == (1.5, "ELLIPSOIDS")
        assert [b_crop.shape for b_crop in b_stipple.crops] == ["SPHERE"]
        bpy.ops.wm.save_mainfile()


def test_undo_takes_a_look_back() -> None:
    """Blender's undo keeps it like any property."""
    b_object = add_capture(random_cloud(), "Statue")
    bpy.ops.ed.undo_push(message="before")
    b_object.stipple.exposure = 3.0
    bpy.ops.ed.undo_push(message="after")
    bpy.ops.ed.undo()
    assert bpy.data.objects["Statue"].stipple.exposure == 0.0
