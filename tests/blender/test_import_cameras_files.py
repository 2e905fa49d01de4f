# SPDX-License-Identifier: GPL-3.0-or-later
"""bpy.ops.import_scene.splat_cameras: photographs behind the cameras, and failures that leave nothing."""

from __future__ import annotations

from pathlib import Path

import bpy
import pytest

from .camera_models import datablocks, import_cameras, messages, write_model
from .captures import add_camera

pytestmark = pytest.mark.blender


def write_images(folder: Path, names: list[str]) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    for name in names:
        b_image = bpy.data.images.new("written", 8, 6)
        b_image.filepath_raw, b_image.file_format = str(folder / name), "PNG"
        b_image.save()
        bpy.data.images.remove(b_image)


def test_background_images(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    path = write_model(tmp_path / "garden" / "sparse" / "0", count=3)
    write_images(tmp_path / "garden" / "images", ["frame_0007.png", "frame_0009.png"])
    capfd.readouterr()
    b_objects = import_cameras(path)
    (info,) = messages(capfd, "Info")
    assert "imported 3 cameras. Background images: 2 found, 1 missing." in info
    for b_object, name in zip(b_objects, ("frame_0007.png", None, "frame_0009.png"), strict=True):
        b_backgrounds = b_object.data.background_images
        assert [Path(b.image.filepath).name for b in b_backgrounds] == ([name] if name else [])
        assert b_object.data.show_background_images == bool(name)
    assert tuple(b_objects[0].data.background_images[0].image.size) == (8, 6)
    bpy.data.batch_remove([*b_objects, *bpy.data.collections])
    assert not any(b_object.data.background_images for b_object in import_cameras(path, background_images=False))


def test_background_sequence(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    path, b_scene = write_model(tmp_path / "model", count=3), bpy.context.scene
    write_images(tmp_path / "images", [f"frame_{number:04d}.png" for number in (7, 8, 9)])
    b_scene.frame_start = 5
    (b_object,) = import_cameras(path, as_animation=True)
    (b_background,) = b_object.data.background_images
    for frame, number in ((5, 7), (7, 9), (6, 8)):
        b_scene.frame_set(frame)
        shown = b_background.image.filepath_from_user(image_user=b_background.image_user)
        assert Path(shown).name == f"frame_{number:04d}.png"
    bpy.data.batch_remove([b_object, *bpy.data.collections])
    (tmp_path / "images" / "frame_0008.png").unlink()
    capfd.readouterr()
    (b_object,) = import_cameras(path, as_animation=True)
    assert not b_object.data.background_images
    assert "1 missing. They are not shown, for they are no sequence" in messages(capfd, "Info")[0]


@pytest.mark.parametrize("as_animation", [True, False])
def test_failures_leave_nothing(tmp_path: Path, as_animation: bool) -> None:
    """A damaged file, and a collection that cannot take the cameras after all of them were made."""
    b_before = add_camera()
    path = write_model(tmp_path / "model", count=3)
    write_images(tmp_path / "images", ["frame_0007.png", "frame_0008.png", "frame_0009.png"])
    linked = tmp_path / "library.blend"
    b_collection = bpy.data.collections.new("Library")
    bpy.data.libraries.write(str(linked), {b_collection})
    bpy.data.collections.remove(b_collection)
    with bpy.data.libraries.load(str(linked), link=True) as (_, wanted):
        wanted.collections = ["Library"]
    bpy.context.scene.collection.children.link(wanted.collections[0])
    bpy.context.view_layer.active_layer_collection = bpy.context.view_layer.layer_collection.children["Library"]
    b_scene, before = bpy.context.scene, datablocks()
    state = (b_scene.frame_end, b_scene.render.resolution_x)
    with pytest.raises(RuntimeError, match="active collection is linked from another file"):
        bpy.ops.import_scene.splat_cameras(filepath=str(path), as_animation=as_animation)
    (path / "images.bin").write_bytes((path / "images.bin").read_bytes()[:-5])
    with pytest.raises(RuntimeError, match=r"images\.bin: image 3 of 3: the file ends inside it") as caught:
        bpy.ops.import_scene.splat_cameras(filepath=str(path), as_animation=as_animation)
    assert "Traceback" not in str(caught.value) and len(str(caught.value).strip().splitlines()) == 1
    assert datablocks() == before
    assert (b_scene.frame_end, b_scene.render.resolution_x) == state
    assert b_scene.camera == b_before
