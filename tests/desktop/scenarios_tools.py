# SPDX-License-Identifier: GPL-3.0-or-later
"""Tools, brushes, axes and numbers of Edit Splats, and captures taken apart, aligned and joined, in a window."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import bpy
import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parent))
from hand import Hand, begin_editing, choose_tool, chosen_positions, digest, flags, splat_count
from window import Steps, Window, run, use_stipple

ICONS = {"paint": 381, "select": 423}  # of the toolbar, below the upper edge of the 3D view [px]
MOVE_IN_MENU = ("mousemove 562 40", "click 1", "mousemove 562 64", "click 1")  # the header's last menu, its first entry
LEFT, RIGHT = ((0.4, 0.6), (0.44, 0.65), (0.47, 0.7)), ((0.5, 0.6), (0.53, 0.65), (0.56, 0.7))
LOOP = ((0.44, 0.55), (0.5, 0.56), (0.55, 0.6), (0.52, 0.68), (0.46, 0.7), (0.43, 0.62))


def selecting(window: Window, hand: Hand) -> Any:
    """Box, circle and lasso of the toolbar with their modifiers; linked and similar under the cursor."""
    results = window.results
    for icon, name in (("paint", "paint icon"), ("select", "select icon")):
        yield from hand.do(hand.on_icon(ICONS[icon]), "click 1")
        results[name] = bpy.context.workspace.tools.from_space_view3d_mode("OBJECT").idname
    yield from hand.drag(*LEFT)
    results["box"] = flags(1)
    yield from hand.drag(*RIGHT, modifier="shift")
    results["box and box"] = flags(1)
    yield from hand.drag(*RIGHT, modifier="ctrl")
    results["box again"] = flags(1)
    choose_tool(window, "stipple.select_circle_tool")
    yield from hand.drag((0.5, 0.5), (0.51, 0.5))
    results["circle"] = flags(1)
    yield from hand.drag((0.5, 0.62), (0.51, 0.62), modifier="shift")
    results["circle and circle"] = flags(1)
    choose_tool(window, "stipple.select_lasso_tool")
    yield from hand.drag(*LOOP)
    results["lasso"] = flags(1)
    yield from window.shot("tools-lasso")
    yield from hand.do("key alt+a", hand.at(0.5, 0.6), "key shift+g")
    results["similar"] = flags(1)
    yield from hand.do("key alt+a", hand.at(0.5, 0.6), "key l")
    results["linked"] = flags(1)
    yield from window.shot("tools-linked")
    yield from hand.do("key shift+l")
    results["linked taken away"] = flags(1)


def brushes(window: Window, hand: Hand) -> Any:
    """F and Shift-F, the clone stamp, and erasing paint."""
    results, b_settings = window.results, bpy.context.scene.stipple_edit
    choose_tool(window, "stipple.paint_tool")
    for name, keys in (("radius", "key f"), ("strength", "key shift+f")):
        before = getattr(b_settings, name)
        yield from hand.do(hand.at(0.5, 0.5), keys, hand.at(0.48, 0.5), "click 1")
        results[name] = [before, getattr(b_settings, name)]
    b_settings.radius, b_settings.strength = 30, 1.0
    before = digest()
    b_settings.selected_only = True  # of nothing: refused, and Blender goes on
    yield from hand.do("key alt+a")
    yield from hand.drag((0.46, 0.55), (0.5, 0.56), (0.54, 0.55))
    results["painted on nothing"] = digest() != before
    b_settings.selected_only = False
    yield from hand.close_error()
    yield from hand.drag((0.46, 0.55), (0.5, 0.56), (0.54, 0.55))
    results["painted"] = digest() != before
    choose_tool(window, "stipple.erase_tool")
    yield from hand.drag((0.4, 0.55), (0.45, 0.55), (0.5, 0.56), (0.54, 0.55), (0.6, 0.55))
    yield from window.shot("tools-erased")
    choose_tool(window, "stipple.clone_tool")
    count = splat_count()
    yield from hand.do(hand.at(0.55, 0.8), "keydown ctrl", "click 1", "keyup ctrl")
    results["source"] = bpy.context.scene.stipple_edit.has_clone_source
    yield from hand.drag((0.44, 0.5), (0.47, 0.5), (0.5, 0.5))
    results["cloned"] = splat_count() - count
    yield from window.shot("tools-cloned")
    yield from hand.do("key ctrl+z")
    results["clones after undo"] = splat_count() - count


def exact(window: Window, hand: Hand) -> Any:
    """G, R and S with axes, planes and numbers; M."""
    results = window.results
    choose_tool(window, "stipple.select_box_tool")
    yield from hand.drag(*LEFT)
    yield from window.shot("tools-exact")
    for name, keys in (
        ("Splats > Move Y -0.5", (*MOVE_IN_MENU, "key y", "key minus", "key period", "key 5")),
        ("G Y -0.5", ("key g", "key y", "key minus", "key period", "key 5")),
        ("G Shift-Z 0.25", ("key g", "key shift+z", "key period", "key 2", "key 5")),
        ("R X 90", ("key r", "key x", "key 9", "key 0")),
        ("S Z 2", ("key s", "key z", "key 2")),
        ("M X", ("key m", "key x")),
    ):
        before = chosen_positions()
        yield from hand.do(*keys, *([] if keys[0] == "key m" else ["key Return"]))
        after = chosen_positions()
        results[name] = [(after.mean(axis=0) - before.mean(axis=0)).tolist(), np.ptp(before, axis=0).tolist()]
        results[name] += [np.ptp(after, axis=0).tolist(), bool(np.array_equal(before, after))]
        yield from hand.do("key ctrl+z")
        results[f"{name} undone"] = bool(np.array_equal(before, chosen_positions()))


def apart(window: Window, hand: Hand) -> Any:
    """P, three pairs of points, and Ctrl-J."""
    results, whole = window.results, splat_count()
    yield from hand.do("key p")
    b_object = bpy.context.object
    (b_part,) = set(bpy.context.scene.objects) - {b_object}
    results["separated"] = len(b_part.data.points)
    yield from hand.do("key e")
    results["left behind"] = splat_count()
    places = [((0.44, 0.75), (0.46, 0.5)), ((0.465, 0.75), (0.5, 0.5)), ((0.45, 0.7), (0.48, 0.56))]
    b_part.location = (0.0, 0.0, 0.4)
    b_object.select_set(False)
    bpy.context.view_layer.objects.active = b_part
    yield from window.rest()
    yield from hand.do(hand.at(0.5, 0.5), "click 3")
    yield from hand.do("mousemove 418 759", "click 1")  # the menu's last entry, Align by Three Points
    yield from window.shot("tools-apart")
    for source, target in places:
        yield from hand.do(hand.at(*source), "click 1", hand.at(*target), "click 1")
    yield from window.shot("tools-aligned")
    results["aligned"] = list(b_part.location)
    bpy.ops.ed.undo_push(message="Aligned")
    b_object.select_set(True)
    bpy.context.view_layer.objects.active = b_object
    yield from hand.do("key ctrl+j")
    results["joined"] = [splat_count(), whole, len(bpy.context.scene.objects)]
    yield from window.shot("tools-joined")


def tools(window: Window) -> Steps:
    use_stipple()
    hand = Hand(window)
    yield from begin_editing(window, hand, sys.argv[-1])
    yield from selecting(window, hand)
    yield from brushes(window, hand)
    yield from exact(window, hand)
    yield from apart(window, hand)


run({"tools": tools})
