# SPDX-License-Identifier: GPL-3.0-or-later
"""Whether final renders get Blender's graphics context: only while a scene of the file uses *rays*.

An engine class says once, when it is registered, whether it wants the context. Wanting it always would cost the others:
Blender's windows stand still while a render holds it, and in the background Blender ends with a crash where no context
can be made. So the class is registered again when the answer changes, and never says yes where there is no graphics.
"""

from __future__ import annotations

from typing import Any

import bpy
from bpy.app.handlers import persistent

from .graphics import has_graphics
from .render_engine import StippleRenderEngine as Engine


def wants_graphics() -> bool:
    """Whether a scene of the open file renders with Stipple's *rays*, and can."""
    b_scenes = getattr(bpy.data, "scenes", ())  # none while an add-on is being registered
    return any(b_scene.stipple.method == "RAYS" for b_scene in b_scenes) and has_graphics()


def follow_the_file() -> None:
    """Register the engine again if the file's scenes now want the other answer."""
    if Engine.is_registered and Engine.bl_use_gpu_context != wants_graphics():
        bpy.utils.unregister_class(Engine)
        Engine.bl_use_gpu_context = not Engine.bl_use_gpu_context
        bpy.utils.register_class(Engine)


@persistent
def _follow_after_load(*_: Any) -> None:
    follow_the_file()


def register() -> None:
    bpy.app.handlers.load_post.append(_follow_after_load)


def unregister() -> None:
    bpy.app.handlers.load_post.remove(_follow_after_load)
