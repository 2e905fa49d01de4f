# SPDX-License-Identifier: GPL-3.0-or-later
"""Render a short camera move through a capture with Blender's module, in the background; `scripts/demo` runs it.

Does what a user does by hand: import with the operator, an empty as the pivot of the camera, two keyframes, render
animation, and the frames into Blender's sequencer for the video. Without a file it first makes the project's own
sample. Everything goes to demo-output/: the frames, demo.mp4, demo.blend and Blender's log.
"""

from __future__ import annotations

import argparse
import math
import os
import sys
import time
from pathlib import Path
from typing import Any

import bpy
import numpy as np
from mathutils import Vector

import stipple
from stipple.engine.errors import StippleError
from stipple.engine.formats import read_splats, write_splats
from stipple.engine.orbit import Framing, frame_clouds

ROOT = Path(__file__).resolve().parent.parent
UP_AXES = {"x": "X", "y": "Y", "z": "Z", "-x": "NEGATIVE_X", "-y": "NEGATIVE_Y", "-z": "NEGATIVE_Z"}
FRAMES_PER_SECOND = 24
FOCAL_ANGLE = math.radians(36)  # vertical field of view
# First and last frame: turn around the up axis and height above the horizon [rad], distance [of the framing one].
MOVE = ((math.radians(-42), math.radians(28), 1.0), (math.radians(34), math.radians(12), 0.85))
LOWERED = 0.1  # of the framing's radius: a subject stands on something that fills the lower half of the picture
BACKDROP = (0.012, 0.014, 0.018)  # scene-linear
TERMINAL = os.fdopen(os.dup(1), "w", encoding="utf-8")


def main(arguments: list[str]) -> None:
    options = parse(arguments)
    started = time.monotonic()
    options.output.mkdir(parents=True, exist_ok=True)
    log = options.output / "blender.log"
    send_blender_output_to(log)
    try:
        video = render_move(options)
    except (StippleError, RuntimeError) as error:
        sys.exit(f"demo: {str(error).strip().removeprefix('Error: ')} (Blender's log: {log})")
    say(f"{video} and its {options.frames} frames beside it, after {time.monotonic() - started:.0f} s")


def parse(arguments: list[str]) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="scripts/demo", description="Render a short camera move through a capture.")
    parser.add_argument("file", nargs="?", type=Path, metavar="FILE.ply", help="default: a sample that it makes")
    parser.add_argument(
        "--up", choices=UP_AXES, default="-y", help="the file's up axis; default: --up=-y, as from COLMAP"
    )
    parser.add_argument("--turn", type=float, default=0.0, metavar="DEGREES", help="start further around the capture")
    parser.add_argument("--output", type=Path, default=ROOT / "demo-output", metavar="FOLDER")
    parser.add_argument("--frames", type=int, default=60)
    parser.add_argument("--size", type=size, default=(1280, 720), metavar="WxH")
    parser.add_argument("--method", choices=("sorted", "points"), default="sorted")
    parser.add_argument("--samples", type=int, default=64, help="for points; default: 64")
    options = parser.parse_args(arguments)
    if options.frames < 1:
        parser.error("--frames: give at least 1")
    return options


def size(text: str) -> tuple[int, int]:
    width, height = (int(part) for part in text.lower().split("x"))
    return width, height


def send_blender_output_to(path: Path) -> None:
    """Blender's and Warp's lines, several per frame, go to a file; `say` and Python's errors go where they went."""
    sys.stdout.flush()
    sys.stderr = os.fdopen(os.dup(2), "w", encoding="utf-8", buffering=1)
    with open(path, "wb") as file:
        os.dup2(file.fileno(), 1)
        os.dup2(file.fileno(), 2)


def say(text: str) -> None:
    print(f"demo: {text}", file=TERMINAL, flush=True)


def render_move(options: argparse.Namespace) -> Path:
    """Import, animate, render and join; returns the video."""
    capture = options.file or make_sample(options.output)
    bpy.ops.wm.read_factory_settings(use_empty=True)
    stipple.register()
    b_scene = bpy.context.scene
    bpy.ops.import_scene.splats(filepath=str(capture.absolute()), up_axis=UP_AXES[options.up])
    b_object = bpy.context.object
    say(f"imported {capture.name}")
    add_camera_move(b_scene, b_object, frame_clouds([read_splats(capture).cloud]), options)
    set_up_render(b_scene, options)
    bpy.ops.wm.save_as_mainfile(filepath=str(options.output.absolute() / "demo.blend"), compress=True)
    frames = render_frames(b_scene, options)
    return join_frames(frames, options)


def make_sample(output: Path) -> Path:
    from stipple.scripts.sample_capture import build_sample

    started = time.monotonic()
    path = output / "sample.ply"
    cloud = build_sample()
    write_splats(path, cloud)
    say(f"made a sample of {cloud.splat_count:,} splats in {time.monotonic() - started:.0f} s")
    return path


def add_camera_move(b_scene: Any, b_object: Any, framing: Framing, options: argparse.Namespace) -> None:
    """A camera on a pivot in the middle of the capture; two keyframes, which Blender eases in and out of."""
    bpy.context.view_layer.update()
    world_from_object = np.array(b_object.matrix_world)
    b_pivot = bpy.data.objects.new("Pivot", None)
    b_pivot.location = Vector(world_from_object[:3, :3] @ framing.centre + world_from_object[:3, 3])
    b_pivot.location.z -= LOWERED * framing.radius
    b_camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    b_camera.data.sensor_fit = "VERTICAL"
    b_camera.data.angle = FOCAL_ANGLE
    b_camera.rotation_euler = (math.pi / 2, 0, 0)  # looks along +y, z up
    b_camera.parent = b_pivot
    for b_new in (b_pivot, b_camera):
        b_scene.collection.objects.link(b_new)
    width, height = options.size
    narrow = math.atan(math.tan(FOCAL_ANGLE / 2) * min(1.0, width / height))
    distance = framing.radius / math.sin(narrow)
    b_camera.data.clip_start, b_camera.data.clip_end = 0.01 * distance, 100 * distance
    for frame, (turn, rise, share) in zip((1, options.frames), MOVE, strict=True):
        b_pivot.rotation_euler = (-rise, 0, turn + math.radians(options.turn))
        b_camera.location = (0, -share * distance, 0)
        b_pivot.keyframe_insert("rotation_euler", frame=frame)
        b_camera.keyframe_insert("location", frame=frame)
    b_scene.camera = b_camera


def set_up_render(b_scene: Any, options: argparse.Namespace) -> None:
    b_scene.render.engine = "STIPPLE"
    b_scene.stipple.method = options.method.upper()
    b_scene.stipple.samples = options.samples
    b_scene.render.resolution_x, b_scene.render.resolution_y = options.size
    b_scene.render.fps = FRAMES_PER_SECOND
    b_scene.frame_start, b_scene.frame_end = 1, options.frames
    b_scene.view_settings.view_transform = "Standard"
    b_scene.render.image_settings.file_format = "PNG"
    b_scene.render.image_settings.color_mode = "RGB"
    b_scene.render.filepath = str(options.output.absolute() / "frame-")
    b_scene.world = bpy.data.worlds.new("World")
    b_scene.world.color = BACKDROP
    if b_scene.world.node_tree:  # from 5.0 a new world has nodes
        b_scene.world.node_tree.nodes["Background"].inputs["Color"].default_value = (*BACKDROP, 1.0)
        b_scene.world.node_tree.nodes["Background"].inputs["Strength"].default_value = 1.0


def render_frames(b_scene: Any, options: argparse.Namespace) -> list[Path]:
    """Render the animation, with a line every few seconds; returns the frames' files."""
    for old in options.output.glob("frame-*.png"):
        old.unlink()
    started = time.monotonic()
    said = started
    say(f"rendering {options.frames} frames of {options.size[0]}×{options.size[1]} (the first compiles the kernels)")

    def report(b_rendered: Any, _depsgraph: Any = None) -> None:
        nonlocal said
        now = time.monotonic()
        if now - said > 10:
            said = now
            say(f"frame {b_rendered.frame_current} of {options.frames} after {now - started:.0f} s")

    bpy.app.handlers.render_write.append(report)
    bpy.ops.render.render(animation=True)
    bpy.app.handlers.render_write.remove(report)
    frames = sorted(options.output.glob("frame-*.png"))
    if len(frames) != options.frames:
        raise StippleError(f"Blender wrote {len(frames)} of {options.frames} frames.")
    say(f"rendered {len(frames)} frames in {time.monotonic() - started:.0f} s")
    return frames


def join_frames(frames: list[Path], options: argparse.Namespace) -> Path:
    """The frames as one H.264 video, made by Blender's sequencer in a scene of its own."""
    b_scene = bpy.data.scenes.new("Video")
    b_editor = b_scene.sequence_editor_create()
    b_strips = b_editor.strips if hasattr(b_editor, "strips") else b_editor.sequences  # renamed in 4.4
    b_strip = b_strips.new_image("Frames", str(frames[0].absolute()), channel=1, frame_start=1)
    for frame in frames[1:]:
        b_strip.elements.append(frame.name)
    b_render = b_scene.render
    b_scene.frame_start, b_scene.frame_end = 1, len(frames)
    b_scene.view_settings.view_transform = "Standard"
    b_render.resolution_x, b_render.resolution_y = options.size
    b_render.fps = FRAMES_PER_SECOND
    if hasattr(b_render.image_settings, "media_type"):  # from 5.0
        b_render.image_settings.media_type = "VIDEO"
    else:
        b_render.image_settings.file_format = "FFMPEG"
    b_render.ffmpeg.format, b_render.ffmpeg.codec = "MPEG4", "H264"
    b_render.ffmpeg.constant_rate_factor = "HIGH"
    video = options.output.absolute() / "demo.mp4"
    b_render.use_file_extension = False
    b_render.filepath = str(video)
    bpy.ops.render.render(animation=True, scene=b_scene.name)
    if not video.exists():
        raise StippleError("Blender's sequencer wrote no video; the frames are there.")
    return video


if __name__ == "__main__":
    main(sys.argv[1:])
