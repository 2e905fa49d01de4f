# SPDX-License-Identifier: GPL-3.0-or-later
"""What a module keeps for one .blend: freed before the next is loaded, and when the add-on is disabled."""

from __future__ import annotations

from collections.abc import Callable

import bpy
from bpy.app.handlers import persistent


def kept_for_file(free: Callable[[], None]) -> tuple[Callable[[], None], Callable[[], None]]:
    """`register` and `unregister` of a module that has nothing but `free` to say to them."""

    @persistent
    def free_before_load(*_: object) -> None:
        free()

    def register() -> None:
        bpy.app.handlers.load_pre.append(free_before_load)

    def unregister() -> None:
        bpy.app.handlers.load_pre.remove(free_before_load)
        free()

    return register, unregister
