# SPDX-License-Identifier: GPL-3.0-or-later
"""The render engine as Blender sees it: thin, without state of its own between frames.

Blender makes one engine object per final render and one per viewport; the latter keeps its Viewport until it ends.
"""

from __future__ import annotations

import logging
import time
import weakref
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import bpy

from ..engine.camera import Camera
from ..engine.errors import Cancelled, StippleError
from ..engine.scene import Scene
from ..engine.settings import Settings
from . import output, residency, sync
from .camera import camera_from_blender
from .viewport_draw import Viewport
from .world import working_space

if TYPE_CHECKING:
    from ..engine.film import Light

ENGINE_ID = "STIPPLE"
SHOW_INTERVAL = 2.0  # [s] between unfinished pictures in the render window
STATS_INTERVAL = 0.25  # [s] between status lines: each is a line of the log in background renders
log = logging.getLogger(__package__)


class StippleRenderEngine(bpy.types.RenderEngine):
    """Final frames and viewports of Gaussian splat captures."""

    bl_idname = ENGINE_ID
    bl_label = "Stipple"
    bl_use_preview = False
    bl_use_gpu_context = False  # see graphics_context
    bl_use_shading_nodes_custom = False  # the world's shader nodes are Blender's own

    def update_render_passes(self, scene: Any = None, renderlayer: Any = None) -> None:
        output.register_passes(self, scene, renderlayer)

    def view_update(self, context: Any, depsgraph: Any) -> None:
        self._of_viewport().update(context, depsgraph)

    def view_draw(self, context: Any, depsgraph: Any) -> None:
        self._of_viewport().draw(self, context, depsgraph)

    def _of_viewport(self) -> Viewport:
        viewport = self.__dict__.get("_viewport")
        if viewport is None or viewport.session.closed:
            viewport = self.__dict__["_viewport"] = Viewport(self)
            weakref.finalize(self, viewport.close).atexit = False  # Blender frees the engine with its viewport
        return viewport

    def render(self, depsgraph: Any) -> None:
        # An exception that leaves this function makes Blender save a black frame and go on: none may.
        try:
            render_view_layer(self, depsgraph)
        except Cancelled:
            self.update_stats("", "Cancelled")
        except StippleError as error:
            fail(self, str(error))
        except MemoryError:
            residency.free()
            fail(self, "Stipple ran out of memory; lower the resolution or supersampling, or hide some captures.")
        except KeyboardInterrupt:
            fail(self, "The render was interrupted from the keyboard.")
        except Exception as error:
            log.exception("Unexpected error while rendering")
            fail(self, f"Stipple could not render: {type(error).__name__}: {error} (details are in the console).")


class Progress:
    """Shows the engine's progress in Blender and asks it whether to stop; called between launches."""

    def __init__(self, b_engine: Any, start: float, share: float) -> None:
        self._b_engine = b_engine
        self._start, self._share = start, share
        self._began = time.monotonic()
        self._shown = 0.0

    def __call__(self, fraction: float, text: str) -> None:
        """`fraction` 0 … 1 of this view; raises Cancelled when the user asked to stop."""
        if self._b_engine.test_break():
            raise Cancelled
        self._b_engine.update_progress(self._start + self._share * fraction)
        now = time.monotonic()
        if now - self._shown >= STATS_INTERVAL:
            self._shown = now
            self._b_engine.update_stats("", text.capitalize() + self._remaining(fraction, now - self._began))

    @staticmethod
    def _remaining(fraction: float, elapsed: float) -> str:
        if fraction < 0.02 or elapsed < 0.5:
            return ""
        seconds = round(elapsed * (1 - fraction) / fraction)
        return f" | Remaining {seconds // 3600:02d}:{seconds // 60 % 60:02d}:{seconds % 60:02d}"


def render_view_layer(b_engine: Any, depsgraph: Any) -> None:
    """Renders each stereo view of the depsgraph's view layer into the result; raises StippleError or Cancelled."""
    b_scene, layer = depsgraph.scene, depsgraph.view_layer.name
    settings = sync.settings_from_scene(b_scene)
    cameras = _cameras(b_engine, b_scene, layer)
    b_engine.update_stats("", "Reading captures")
    scene, warnings = sync.scene_from_depsgraph(depsgraph, residency.clouds)
    if not scene.instances:
        warnings += (f"No capture is visible in the view layer {layer!r}; the frame shows the background only.",)
    begin = Progress(b_engine, 0.0, 0.0)
    said = list(warnings)

    def render_views(device: str) -> None:
        residency.prepare(device, settings.method, begin)
        renderer = residency.renderer_for(device)
        for index, (view, camera) in enumerate(cameras.items()):
            progress = Progress(b_engine, index / len(cameras), 1 / len(cameras))
            for light in _pictures(renderer, scene, camera, settings, progress):
                output.write_light(b_engine, light, layer, view)
                said.extend(light.stats.warnings)
                peak_mib = light.stats.peak_bytes / 2**20
                b_engine.update_memory_stats(memory_used=peak_mib, memory_peak=peak_mib)

    with residency.worker.final_render(lambda: begin(0.0, "waiting for the viewport")):
        residency.on_a_device(settings.device, render_views, said.append)
    for warning in dict.fromkeys(said):
        b_engine.report({"WARNING"}, warning)


def _pictures(renderer: Any, scene: Scene, camera: Camera, settings: Settings, progress: Progress) -> Iterator[Light]:
    """The finished picture; before it, with a window to look at, what is done so far every now and then.

    When the user cancels, what is done, and Cancelled after that.
    """
    from ..engine.renderer import Frame

    try:
        frame = Frame(renderer, scene, camera, settings, progress)
        shown = time.monotonic() - SHOW_INTERVAL  # the first sample is shown at once
        try:
            for sample in range(frame.sample_count):
                frame.render_sample(sample)
                unfinished = frame.film.samples < frame.sample_count
                if unfinished and not bpy.app.background and time.monotonic() - shown >= SHOW_INTERVAL:
                    yield frame.resolve_light(working_space())
                    shown = time.monotonic()
        except Cancelled:
            if frame.film.samples:
                yield frame.resolve_light(working_space())
            raise
        yield frame.resolve_light(working_space())
    finally:
        renderer.release_raster()  # Blender ends the graphics context with the frame


def fail(b_engine: Any, text: str) -> None:
    """Shows one sentence in the render window and the log and stops the render, an animation too.

    Only the report stops Blender from saving a black frame; only the engine's error shows in the render window.
    """
    b_engine.error_set(text)
    b_engine.report({"ERROR"}, text)


def _cameras(b_engine: Any, b_scene: Any, layer: str) -> dict[str, Camera]:
    """An engine Camera per stereo view; one view named "" when stereoscopy is off."""
    b_render, b_camera = b_scene.render, b_engine.camera_override
    if b_camera is None:
        raise StippleError("The scene has no camera; add one and choose it in Scene properties > Camera.")
    if not b_render.use_multiview:
        return {"": camera_from_blender(b_camera, b_render)}
    if b_render.views_format != "STEREO_3D":
        raise StippleError("Stipple renders stereo pairs only; set Output > Stereoscopy to Stereo 3D.")
    cameras = {}
    for view in output.view_names(b_engine, layer):
        b_engine.active_view_set(view)
        matrix = b_engine.camera_model_matrix(b_camera)
        cameras[view] = camera_from_blender(b_camera, b_render, matrix, b_engine.camera_shift_x(b_camera))
    return cameras


def register() -> None:
    bpy.utils.register_class(StippleRenderEngine)


def unregister() -> None:
    bpy.utils.unregister_class(StippleRenderEngine)
