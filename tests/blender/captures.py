# SPDX-License-Identifier: GPL-3.0-or-later
"""Small captures made here, their PLY files and what tests place in a Blender scene."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest

from stipple.addon import residency
from stipple.addon.sequence import SequencePlayer
from stipple.addon.splat_data import datablock_from_cloud
from stipple.addon.sync import viewport_instances
from stipple.engine.scene import Instance
from stipple.engine.splats import SH_REST_COUNT, SplatCloud

ARRAYS = ("position", "scale", "rotation", "opacity", "sh_dc", "sh_rest")


def random_cloud(count: int = 200, degree: int = 2, seed: int = 1, size: float = 0.05) -> SplatCloud:
    """Splats in the cube -1 … 1, about `size` large, mostly opaque, with raw SH values of both signs."""
    rng = np.random.default_rng(seed)
    rotation = rng.normal(size=(count, 4))
    arrays = {
        "position": rng.uniform(-1, 1, (count, 3)),
        "scale": size * np.exp(rng.normal(0, 0.4, (count, 3))),
        "rotation": rotation / np.linalg.norm(rotation, axis=1, keepdims=True),
        "opacity": rng.uniform(0.3, 1, count),
        "sh_dc": rng.normal(0, 1, (count, 3)),
        "sh_rest": rng.normal(0, 0.2, (count, SH_REST_COUNT[degree], 3)),
    }
    return SplatCloud(**{name: np.ascontiguousarray(array, np.float32) for name, array in arrays.items()})


def write_ply(path: Path, cloud: SplatCloud) -> Path:
    """A little-endian 3DGS PLY as INRIA's trainer writes it, with logarithms and logits."""
    rest_count = cloud.sh_rest.shape[1]
    columns = {"xyz"[axis]: cloud.position[:, axis] for axis in range(3)}
    columns |= {f"f_dc_{i}": cloud.sh_dc[:, i] for i in range(3)}
    channels_first = cloud.sh_rest.transpose(0, 2, 1).reshape(cloud.splat_count, -1)
    columns |= {f"f_rest_{i}": channels_first[:, i] for i in range(3 * rest_count)}
    opacity = np.clip(cloud.opacity.astype(np.float64), 1e-6, 1 - 1e-6)
    columns["opacity"] = np.log(opacity / (1 - opacity))
    columns |= {f"scale_{i}": np.log(cloud.scale[:, i]) for i in range(3)}
    columns |= {f"rot_{i}": cloud.rotation[:, i] for i in range(4)}
    header = "".join(f"property float {name}\n" for name in columns)
    table = np.stack(list(columns.values()), axis=1).astype("<f4")
    text = f"ply\nformat binary_little_endian 1.0\nelement vertex {cloud.splat_count}\n{header}end_header\n"
    path.write_bytes(text.encode("ascii") + table.tobytes())
    return path


def add_capture(cloud: SplatCloud, name: str = "Capture") -> Any:
    """An object with the cloud's datablock in the scene's collection."""
    b_object = bpy.data.objects.new(name, datablock_from_cloud(cloud, name))
    bpy.context.scene.collection.objects.link(b_object)
    return b_object


def in_viewport() -> tuple[tuple[Instance, ...], tuple[str, ...]]:
    """What a 3D viewport that has read nothing yet shows of the scene, and its warnings."""
    b_space = next(area.spaces.active for screen in bpy.data.screens for area in screen.areas if area.type == "VIEW_3D")
    known = residency.EvaluatedClouds(residency.CloudCache())
    player = SequencePlayer(residency.sequences)
    return viewport_instances(bpy.context.evaluated_depsgraph_get(), b_space, known, player, ())


def add_camera(location: tuple[float, float, float] = (0.0, -4.0, 0.0)) -> Any:
    """The scene's camera, looking along +Y."""
    b_camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    b_camera.location = location
    b_camera.rotation_euler = (np.pi / 2, 0.0, 0.0)
    bpy.context.scene.collection.objects.link(b_camera)
    bpy.context.scene.camera = b_camera
    return b_camera


def use_stipple(width: int = 64, height: int = 48, method: str = "SORTED") -> Any:
    """Sets the scene up for a small exact render: returns the scene."""
    b_scene = bpy.context.scene
    b_scene.render.engine = "STIPPLE"
    b_scene.render.resolution_x, b_scene.render.resolution_y = width, height
    b_scene.render.resolution_percentage = 100
    b_scene.render.dither_intensity = 0.0
    b_scene.view_settings.view_transform = "Standard"
    b_scene.stipple.method = method
    b_scene.stipple.device = "CPU"
    b_scene.stipple.samples = 4
    return b_scene


def assert_same_cloud(left: SplatCloud, right: SplatCloud) -> None:
    """Every array equal bit by bit."""
    for name in ARRAYS:
        a, b = getattr(left, name), getattr(right, name)
        assert a.shape == b.shape, name
        assert np.array_equal(a.view(np.uint32), b.view(np.uint32)), name


def pixels_of(path: Path) -> np.ndarray:
    """(H, W, 4) of an image file as Blender reads it, rows from the top; EXR scene-linear, PNG as stored."""
    b_image = bpy.data.images.load(str(path), check_existing=False)
    b_image.colorspace_settings.name = "Non-Color"
    if path.suffix == ".png":
        b_image.alpha_mode = "STRAIGHT"
    values = np.empty(len(b_image.pixels), np.float32)
    b_image.pixels.foreach_get(values)
    width, height = b_image.size
    bpy.data.images.remove(b_image)
    return values.reshape(height, width, 4)[::-1]


def render(path: Path, **options: Any) -> np.ndarray:
    """Renders the current frame to a file, as F12 and Save do, and reads it back."""
    b_settings = bpy.context.scene.render.image_settings
    b_settings.file_format = "PNG" if path.suffix == ".png" else "OPEN_EXR"
    b_settings.color_mode = "RGBA"
    b_settings.color_depth = "8" if path.suffix == ".png" else "32"
    bpy.context.scene.render.filepath = str(path)
    bpy.ops.render.render(write_still=True, **options)
    return pixels_of(path)


def render_channel(path: Path, name: str) -> np.ndarray:
    """Renders the current frame to a multilayer EXR; (H, W) of one of its channels, "LAYER.PASS.CHANNEL"."""
    openexr = pytest.importorskip("OpenEXR")
    b_settings = bpy.context.scene.render.image_settings
    if bpy.app.version >= (5, 0, 0):
        b_settings.media_type = "MULTI_LAYER_IMAGE"
    b_settings.file_format = "OPEN_EXR_MULTILAYER"
    b_settings.color_depth = "32"
    bpy.context.scene.render.filepath = str(path)
    bpy.ops.render.render(write_still=True)
    with openexr.File(str(path), separate_channels=True) as file:
        # Blender 5 writes a part for each pass, 4.5 all of them in one.
        return np.array(next(part.channels[name].pixels for part in file.parts if name in part.channels))
