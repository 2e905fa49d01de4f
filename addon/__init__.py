# SPDX-License-Identifier: GPL-3.0-or-later
"""The Blender side of Stipple: operators, properties, panels and the render engine. The only folder that imports bpy.

Registering is cheap: Warp is imported by the first render, never here.
"""

from __future__ import annotations

import atexit

import bpy

from . import (
    capture_panel,
    edits_beside_blend,
    graphics_context,
    library_overrides,
    linked_capture,
    linked_edits,
    object_panels,
    object_properties,
    overlay,
    preferences,
    properties,
    render_engine,
    residency,
    sequence,
    sequence_panel,
    sequence_paths,
    ui,
)
from .edit import kernels as edit_kernels
from .edit import keymap as edit_keymap
from .edit import mode as edit_mode
from .edit import properties as edit_properties
from .edit import session as edit_session
from .edit import tools as edit_tools
from .edit import ui as edit_ui
from .edit import visible as edit_visible
from .operators import (
    apply_transform,
    crops,
    edit_clean_up,
    edit_flags,
    edit_objects,
    edit_paint,
    edit_select,
    edit_similar,
    edit_transform,
    export_splats,
    import_cameras,
    import_splats,
    link_captures,
)
from .operators import linked_edits as linked_edits_operators

PARTS = (  # in order; undone in reverse
    preferences,
    properties,
    object_properties,
    sequence,
    sequence_paths,
    library_overrides,
    linked_capture,
    linked_edits,
    edits_beside_blend,
    residency,
    graphics_context,
    import_splats,
    link_captures,
    linked_edits_operators,
    import_cameras,
    apply_transform,
    crops,
    edit_kernels,
    edit_session,
    edit_properties,
    edit_mode,
    edit_flags,
    edit_select,
    edit_transform,
    edit_objects,
    edit_paint,
    edit_similar,
    edit_clean_up,
    export_splats,
    edit_visible,
    edit_keymap,
    edit_tools,
    edit_ui,
    render_engine,
    overlay,
    ui,
    object_panels,
    sequence_panel,
    capture_panel,
)


def register() -> None:
    """Adds everything to Blender; may be called again after `unregister`."""
    for part in PARTS:
        part.register()
    if bpy.app.module:  # bpy 4.5 as a Python module hangs at exit unless all of this is undone before
        atexit.register(unregister)


def unregister() -> None:
    """Takes everything out of Blender and frees what the caches hold; does nothing the second time."""
    atexit.unregister(unregister)
    if not render_engine.StippleRenderEngine.is_registered:
        return
    for part in reversed(PARTS):
        part.unregister()
