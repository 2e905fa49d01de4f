# SPDX-License-Identifier: GPL-3.0-or-later
"""Where compiled kernels are kept."""

from __future__ import annotations

import os

import bpy

FOLDER = "kernels"
CACHE_VARIABLE = "WARP_CACHE_PATH"  # Warp reads it when it starts


def keep_kernels_in_extension_folder() -> None:
    """Tells Warp, before its first import, to keep compiled kernels in the extension's own user folder.

    A user's own setting wins. When Stipple is not installed as an extension (a checkout, the tests) Warp's usual
    cache is used.
    """
    if CACHE_VARIABLE in os.environ:
        return
    package = (__package__ or "").rpartition(".")[0]
    try:
        folder = bpy.utils.extension_path_user(package, path=FOLDER, create=True)
    except ValueError:
        return
    if folder:
        os.environ[CACHE_VARIABLE] = folder
