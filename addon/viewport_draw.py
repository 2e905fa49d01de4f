# SPDX-License-Identifier: GPL-3.0-or-later
"""One viewport of Blender: reads what it shows, aims its session, draws what is done; in the interface's thread."""

from __future__ import annotations

import time
import weakref
from typing import TYPE_CHECKING, Any

import bpy

from ..engine.errors import StippleError
from ..engine.scene import Instance, Scene
from . import residency, sync, world
from .crop_lists import cropped_objects, evaluate_again, with_other_lists
from .edit.preview import shown_previews
from .sequence import SequencePlayer
from .view_camera import view_of
from .viewport import Aim, ViewportSession
from .viewport_rays import RaysViewportSession

if TYPE_CHECKING:
    from ..engine.renderer import Renderer

PATIENCE = 0.1  # [s] a redraw waits for a file of a sequence; then the one before stays until it is there


class Viewport:
    """Belongs to the RenderEngine object of one viewport and ends with it."""

    def __init__(self, b_engine: Any) -> None:
        engine_or_none = weakref.ref(b_engine)  # a reference would keep Blender from ending the engine

        def redraw() -> None:
            b_engine = engine_or_none()
            if b_engine is not None:
                b_engine.tag_redraw()

        from .display import Display  # the gpu module needs a window

        self._redraw = redraw
        self.session = ViewportSession(redraw)
        self._raster: Renderer | None = None  # of *rays*
        self._display = Display()
        self._known = residency.EvaluatedClouds(residency.clouds)
        self._player = SequencePlayer(residency.sequences, PATIENCE, redraw)
        self._cropped: frozenset[str] = frozenset()
        self._instances: tuple[Instance, ...] = ()
        self._scene = Scene(())
        self._visibility: tuple[object, ...] | None = None
        self._notice = ""  # about what was read: a problem, or what is left out
        self._world_notice = ""
        residency.worker.add(self.session)

    def update(self, context: Any, depsgraph: Any) -> None:
        """Reads the scene again after a change; captures that did not change are kept."""
        world.images.look_again()
        self._read(context, depsgraph, sync.changed_geometry(depsgraph))

    def draw(self, b_engine: Any, context: Any, depsgraph: Any) -> None:
        """Draws the newest picture and sees whether it is still of what the viewport looks at."""
        self._time_redraw()
        b_space, b_scene = context.space_data, depsgraph.scene
        if self._visibility != _visibility(b_space) or self._player.is_stale(b_scene):
            self._read(context, depsgraph, ())
        if changed := with_other_lists(self._cropped, depsgraph):
            bpy.app.timers.register(lambda: evaluate_again(changed), first_interval=0.0)
        self._choose_session(b_scene.stipple.method)
        problem = self._aim(context, b_scene)
        self._render_rays()
        texts = (problem or self.session.status(), self._notice, self._world_notice)
        b_engine.update_stats("Stipple", " | ".join(text for text in texts if text))
        picture = None if problem else self.session.take()  # what is there is of another view
        if picture is not None:
            self._display.draw(b_engine, b_scene, picture, (context.region.width, context.region.height))
        residency.worker.wake()

    def close(self) -> None:
        self.session.close()
        residency.worker.wake()
        if self._raster is not None:
            self._raster.free()
            self._raster = None

    def _time_redraw(self) -> None:
        """Finds out how long Blender takes from here until it looks after timers and keys again."""
        begin, session = time.monotonic(), self.session

        def redrawn() -> None:
            session.redraw_seconds = (session.redraw_seconds + time.monotonic() - begin) / 2

        bpy.app.timers.register(redrawn, first_interval=0.0)

    def _choose_session(self, method: str) -> None:
        """*rays* is drawn here and not by the worker, and has another kind of session."""
        kind = RaysViewportSession if method == "RAYS" else ViewportSession
        if type(self.session) is kind:
            return
        self.close()
        self.session = kind(self._redraw)
        residency.worker.add(self.session)

    def _render_rays(self) -> None:
        if not isinstance(self.session, RaysViewportSession) or residency.worker.serves_finals:
            return
        if self._raster is None and self.session.is_sorted:  # Warp and its kernels are loaded then
            self._raster = residency.raster_renderer("cpu")  # pixels come back to the host; the film may stay there
        if self._raster is not None:
            self.session.render(self._raster)

    def _read(self, context: Any, depsgraph: Any, changed: Any) -> None:
        self._visibility = _visibility(context.space_data)
        try:
            self._instances, warnings = sync.viewport_instances(
                depsgraph, context.space_data, self._known, self._player, changed
            )
            self._notice = warnings[0] if warnings else ""
        except StippleError as error:
            self._instances, self._notice = (), str(error)
        except MemoryError:
            self._instances, self._notice = (), "Stipple ran out of memory; hide some captures."
        self._scene = Scene(self._instances, self._scene.background)
        self._cropped = cropped_objects(self._instances)

    def _aim(self, context: Any, b_scene: Any) -> str:
        """Tells the session what to show; returns what is wrong with the view or the settings, mostly nothing."""
        try:
            background, self._world_notice = world.background_of(b_scene)
            if background != self._scene.background:
                self._scene = Scene(self._instances, background)
            view = view_of(context, b_scene)
            aim = Aim(self._scene, view, sync.viewport_settings(b_scene), world.working_space())
            view.camera()  # raises for a view that has no picture
        except StippleError as error:
            return str(error)
        except MemoryError:
            return "Stipple ran out of memory; choose a smaller image in the world."
        if self.session.aim_at(aim):
            residency.worker.wake()  # at once, not after drawing
            self.session.wait_a_moment()
        return ""


def _visibility(b_space: Any) -> tuple[object, ...]:
    """What a viewport shows without being told by the depsgraph."""
    return (*sync.visibility_of(b_space), *shown_previews())
