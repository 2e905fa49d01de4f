# SPDX-License-Identifier: GPL-3.0-or-later
"""Where to read a datablock's attributes: reading the original's costs memory in every undo step."""

from __future__ import annotations

from typing import Any

import bpy


def evaluated_copy(b_data: Any) -> Any:
    """The datablock's evaluated copy, before any modifiers; itself where nothing shows it.

    Blender's undo steps share the arrays of an original until someone reads them (through Python, reading makes them
    private): then each step would keep the capture once more. Tagged first, for scripts may forget to.
    """
    b_data.update_tag()
    return b_data.evaluated_get(bpy.context.evaluated_depsgraph_get())
