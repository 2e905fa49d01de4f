# SPDX-License-Identifier: GPL-3.0-or-later
"""Enabling, disabling, re-enabling; a process that ends."""

from __future__ import annotations

import subprocess
import sys

import bpy
import pytest

import stipple
from stipple.addon import ui

pytestmark = pytest.mark.blender

QUIET_EXIT = """
import sys, bpy, stipple
stipple.register()
assert "warp" not in sys.modules, "registering must not import Warp"
bpy.context.scene.render.engine = "STIPPLE"
print("registered")
"""


def engine_ids() -> set[str]:
    engines = [cls for cls in bpy.types.RenderEngine.__subclasses__() if hasattr(cls, "bl_idname")]
    return {cls.bl_idname for cls in engines if cls.is_registered}


def test_register_again_after_unregister() -> None:
    stipple.unregister()
    stipple.unregister()  # the second time is harmless
    stipple.register()
    handlers = len(bpy.app.handlers.load_pre)
    for _ in range(2):
        stipple.unregister()
        assert "STIPPLE" not in engine_ids()
        assert not hasattr(bpy.types.Scene, "stipple")
        assert not any(
            "STIPPLE" in getattr(p, "COMPAT_ENGINES", ())
            for p in bpy.types.Panel.__subclasses__()
            if not issubclass(p, ui.StipplePanel)
        )
        stipple.register()
        assert "STIPPLE" in engine_ids()
        assert bpy.context.scene.stipple.method == "SORTED"
    assert len(bpy.app.handlers.load_pre) == handlers


def test_settings_are_saved_with_the_file(tmp_path) -> None:  # type: ignore[no-untyped-def]
    bpy.context.scene.render.engine = "STIPPLE"
    bpy.context.scene.stipple.samples = 321
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "settings.blend"))
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    assert bpy.context.scene.stipple.samples == 64
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "settings.blend"))
    assert (bpy.context.scene.render.engine, bpy.context.scene.stipple.samples) == ("STIPPLE", 321)


def test_blenders_panels_are_shared() -> None:
    shared = {
        panel.__name__
        for panel in bpy.types.Panel.__subclasses__()
        if "STIPPLE" in getattr(panel, "COMPAT_ENGINES", ())
    }
    wanted = {
        "RENDER_PT_format",
        "RENDER_PT_output",
        "DATA_PT_lens",
        "VIEWLAYER_PT_layer",
        "WORLD_PT_context_world",
        "RENDER_PT_color_management",
        "EEVEE_WORLD_PT_surface",
        "RENDER_PT_stipple_sampling",
    }
    assert wanted <= shared
    assert "RENDER_PT_freestyle" not in shared


def test_a_process_that_registered_starts_without_warp_and_ends() -> None:
    done = subprocess.run([sys.executable, "-c", QUIET_EXIT], capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 0, done.stderr
    assert "registered" in done.stdout
