# SPDX-License-Identifier: GPL-3.0-or-later
"""Whether this machine can give Blender a graphics context."""

from __future__ import annotations

import ctypes
import sys
from functools import cache

import bpy

PLATFORM_SURFACELESS = 0x31DD  # EGL_PLATFORM_SURFACELESS_MESA: a context without any window system


@cache
def has_graphics() -> bool:
    """Whether a graphics context can be had: always with windows, in the background on Linux where EGL starts.

    Does not make a context. On Windows and macOS the system always has a driver for one.
    """
    if not bpy.app.background or sys.platform != "linux":
        return True
    try:
        egl = ctypes.CDLL("libEGL.so.1")
    except OSError:
        return False
    pointer = ctypes.c_void_p
    egl.eglGetDisplay.restype = egl.eglGetPlatformDisplay.restype = pointer
    egl.eglGetDisplay.argtypes = [pointer]
    egl.eglGetPlatformDisplay.argtypes = [ctypes.c_uint, pointer, pointer]
    egl.eglInitialize.argtypes = [pointer] * 3
    displays = (egl.eglGetDisplay(None), egl.eglGetPlatformDisplay(PLATFORM_SURFACELESS, None, None))
    return any(display and egl.eglInitialize(display, None, None) for display in displays)
