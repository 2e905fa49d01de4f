# SPDX-License-Identifier: GPL-3.0-or-later
"""What the user sets once for all files: *Preferences > Add-ons > Stipple*."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import bpy
from bpy.props import EnumProperty, IntProperty

from ..engine.cache_places import VARIABLE, CachePlaces, places_from_environment, user_cache_folder
from ..engine.capture_file import LARGE_SPLATS

PACKAGE = (__package__ or "").rpartition(".")[0]
CACHE_FOLDER = "captures"  # in the extension's own user folder
CACHES = (
    ("BESIDE", "Beside the Capture", "Write cache files next to captures, or in the user's folder where that fails"),
    ("USER", "User Folder", "Write all cache files to the extension's own folder"),
    ("OFF", "Off", "Write none; large captures take as long to open every time as the first time"),
)


class StipplePreferences(bpy.types.AddonPreferences):
    """Where large captures stay, and their caches."""

    bl_idname = PACKAGE

    link_above: IntProperty(  # type: ignore[valid-type]
        name="Link Above",
        description="Captures with more splats than this stay in their file when they are imported",
        default=LARGE_SPLATS,
        min=0,
    )
    cache: EnumProperty(  # type: ignore[valid-type]
        name="Cache Files",
        description="Where the converted splats of large captures are kept, to open them faster the next time",
        items=CACHES,
        default="BESIDE",
    )

    def draw(self, context: Any) -> None:
        self.layout.use_property_split = True
        self.layout.prop(self, "link_above")
        self.layout.prop(self, "cache")


def _preferences() -> Any:
    """None where the add-on was registered by hand, as in tests."""
    b_addon = bpy.context.preferences.addons.get(PACKAGE)
    return b_addon.preferences if b_addon else None


def link_above() -> int:
    """Captures of more splats are linked when they are imported."""
    b_preferences = _preferences()
    return b_preferences.link_above if b_preferences else LARGE_SPLATS


def cache_places() -> CachePlaces:
    """Where caches of captures are; STIPPLE_CACHE wins over the preferences."""
    if os.environ.get(VARIABLE):
        return places_from_environment()
    b_preferences = _preferences()
    choice = b_preferences.cache if b_preferences else "BESIDE"
    return CachePlaces(beside=choice == "BESIDE", folder=None if choice == "OFF" else _user_folder())


def _user_folder() -> Path:
    try:
        return Path(bpy.utils.extension_path_user(PACKAGE, path=CACHE_FOLDER))
    except ValueError:  # not installed as an extension
        return user_cache_folder()


def register() -> None:
    bpy.utils.register_class(StipplePreferences)


def unregister() -> None:
    bpy.utils.unregister_class(StipplePreferences)
