# SPDX-License-Identifier: GPL-3.0-or-later
"""Names of files that are made of the names of objects and datablocks, each of them once."""

from __future__ import annotations

import bpy


def free_name(before: str, name: str, suffix: str, taken: set[str]) -> str:
    """`before` and the name, as far as a file's can have it, with a number where that is `taken`; it is taken then.

    Two datablocks may have one name once it is a file's; disks may not tell large letters from small ones.
    """
    stem = f"{before}{bpy.path.clean_name(name)}"
    found, number = f"{stem}{suffix}", 0
    while found.lower() in taken:
        number += 1
        found = f"{stem}.{number:03d}{suffix}"
    taken.add(found.lower())
    return found
