# SPDX-License-Identifier: GPL-3.0-or-later
"""Stipple: a render engine for Gaussian splats. Blender calls `register` and `unregister`."""


def register() -> None:
    from . import addon

    addon.register()


def unregister() -> None:
    from . import addon

    addon.unregister()
