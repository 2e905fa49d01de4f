# SPDX-License-Identifier: GPL-3.0-or-later
"""What stays in memory between frames: clouds by content, and the renderer with what it uploaded.

Blender makes a new RenderEngine for every frame, so this lives at module level. Everything is freed when a file
is loaded and when the add-on is disabled.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import bpy
from bpy.app.handlers import persistent

from ..engine.splats import SplatCloud
from .splat_data import CloudKey, cloud_from_datablock, key_of

if TYPE_CHECKING:
    from ..engine.renderer import Renderer

KERNEL_FOLDER = "kernels"
CACHE_VARIABLE = "WARP_CACHE_PATH"  # Warp reads it when it starts

Entry = tuple[SplatCloud | None, int]


class CloudCache:
    """Clouds keyed by content: the same splats give the same SplatCloud object from frame to frame.

    A renderer that uploads per SplatCloud object then uploads each capture once, whatever Blender copies.
    """

    def __init__(self) -> None:
        self._entries: dict[CloudKey, Entry] = {}
        self._last_read: dict[CloudKey, int] = {}
        self._read = 0
        self._key_of_address: dict[int, CloudKey] = {}

    def __len__(self) -> int:
        return len(self._entries)

    @contextmanager
    def reading(self, keep: int = 1) -> Iterator[None]:
        """Brackets the reading of one depsgraph; what none of the last `keep` readings asked for is dropped after it.

        A frame reads once for each view layer, so `keep` is their number.
        """
        self._read += 1
        self._key_of_address.clear()
        yield
        kept = {key: read for key, read in self._last_read.items() if read > self._read - keep}
        self._entries = {key: self._entries[key] for key in kept}
        self._last_read = kept
        self._key_of_address.clear()

    def cloud_of(self, b_data: Any, name: str) -> Entry:
        """The cloud of an evaluated datablock (None without usable splats) and the number of splats left out.

        Only inside `reading`: there an address names one datablock, so instances of it are read once.
        """
        address = b_data.as_pointer()
        key = self._key_of_address.get(address)
        if key is None:
            key = self._key_of_address[address] = key_of(b_data, name)
        if key not in self._entries:
            self._entries[key] = cloud_from_datablock(b_data, name)
        self._last_read[key] = self._read
        return self._entries[key]

    def free(self) -> None:
        self._entries.clear()
        self._last_read.clear()
        self._key_of_address.clear()


clouds = CloudCache()
_renderers: dict[str, Renderer] = {}  # by device; at most one


def is_warm(device: str) -> bool:
    """Whether the renderer for a device exists: if not, the next render may have to compile kernels first."""
    return device in _renderers


def renderer_for(device: str) -> Renderer:
    """The renderer for a device; changing the device frees the one before. Imports Warp on first use."""
    if device not in _renderers:
        free_renderer()
        _keep_kernels_in_extension_folder()
        from ..engine.renderer import Renderer
        from .raster_device import BlenderRasterDevice

        _renderers[device] = Renderer(device, raster_host=BlenderRasterDevice)
    return _renderers[device]


def free_renderer() -> None:
    """Gives back the device memory and ends the worker threads; the next render starts and uploads again."""
    while _renderers:
        _, renderer = _renderers.popitem()
        renderer.free()
        from ..engine.device import close_pools

        close_pools()


def free() -> None:
    """Drops every cloud and renderer."""
    free_renderer()
    clouds.free()


def _keep_kernels_in_extension_folder() -> None:
    """Tells Warp, before its first import, to keep compiled kernels in the extension's own user folder.

    A user's own setting wins. When Stipple is not installed as an extension (a checkout, the tests) Warp's usual
    cache is used.
    """
    if CACHE_VARIABLE in os.environ:
        return
    package = (__package__ or "").rpartition(".")[0]
    try:
        folder = bpy.utils.extension_path_user(package, path=KERNEL_FOLDER, create=True)
    except ValueError:
        return
    if folder:
        os.environ[CACHE_VARIABLE] = folder


@persistent
def _free_before_load(*_: object) -> None:
    free()


def register() -> None:
    bpy.app.handlers.load_pre.append(_free_before_load)


def unregister() -> None:
    bpy.app.handlers.load_pre.remove(_free_before_load)
    free()
