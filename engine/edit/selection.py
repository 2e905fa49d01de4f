# SPDX-License-Identifier: GPL-3.0-or-later
"""Select: put what a `match_…` function found into the selection. Changes only splats that are shown and not locked."""

from __future__ import annotations

from ..errors import StippleError
from .editable_cloud import EditableCloud
from .mask import Mask, empty_mask
from .state import SELECTED
from .step import FlagDiff, Step, flag_step

MODES = ("set", "add", "subtract", "intersect", "difference")
ACTIONS = {"all": "Select All", "none": "Select None", "invert": "Invert Selection"}


def select(cloud: EditableCloud, match: Mask, mode: str = "set", name: str = "Select") -> Step:
    """The step that makes `match` the selection, or combines both.

    `mode` is one of `MODES`: "set" selects what matches and nothing else, "add" also what matches, "subtract" no longer
    what matches, "intersect" only what matches of what is selected, "difference" what is in one of both. A match of
    nothing is no error: with "set" it clears the selection, as a click beside everything does.

    Raises StippleError for another mode, or a match of another cloud's size.
    """
    if mode not in MODES:
        raise StippleError(f"selection mode is {mode!r}; choose one of {', '.join(MODES)}.")
    selected = cloud.selection()
    flipped = {
        "set": lambda: selected ^ (match & cloud.selectable()),
        "add": lambda: (match & cloud.selectable()) - selected,
        "subtract": lambda: selected & match,
        "intersect": lambda: selected - match,
        "difference": lambda: match & cloud.selectable(),
    }[mode]()
    return flag_step(name, SELECTED, flipped)


def select_all(cloud: EditableCloud, action: str = "all") -> Step:
    """The step that selects all that can be selected, nothing, or what was not.

    Raises StippleError for another action than those in `ACTIONS`.
    """
    if action not in ACTIONS:
        raise StippleError(f"selection action is {action!r}; choose one of {', '.join(ACTIONS)}.")
    selected = cloud.selection()
    flipped = {
        "all": lambda: cloud.selectable() - selected,
        "none": lambda: selected,
        "invert": cloud.selectable,
    }[action]()
    return flag_step(ACTIONS[action], SELECTED, flipped)


class SelectionStroke:
    """A brush that selects while it moves: every dab shows at once, and the whole stroke becomes one step.

    `mode` is "add" or "subtract" ("set" clears the selection first). `finish` returns the step, its changes already
    made, for `History.record`, or None where nothing changed; `cancel` puts the selection back as it was.
    """

    def __init__(self, cloud: EditableCloud, mode: str = "add", name: str = "Brush Select") -> None:
        if mode not in ("set", "add", "subtract"):
            raise StippleError(f"brush selection mode is {mode!r}; choose set, add or subtract.")
        self._cloud, self._name = cloud, name
        self._mode = "subtract" if mode == "subtract" else "add"
        self._flipped = empty_mask(cloud.splat_count, cloud.device)
        if mode == "set":
            self._flip(cloud.selection())

    def dab(self, match: Mask) -> None:
        """Select, or deselect, what was found under the brush."""
        selected = self._cloud.selection()
        self._flip(selected & match if self._mode == "subtract" else (match & self._cloud.selectable()) - selected)

    def finish(self) -> Step | None:
        step = flag_step(self._name, SELECTED, self._flipped)
        return step if step.changed else None

    def cancel(self) -> None:
        FlagDiff(SELECTED, self._flipped).revert(self._cloud)
        self._flipped = empty_mask(self._cloud.splat_count, self._cloud.device)

    def _flip(self, flipped: Mask) -> None:
        total = self._flipped ^ flipped
        FlagDiff(SELECTED, flipped).apply(self._cloud)
        self._flipped = total


def selected_or_refuse(cloud: EditableCloud, verb: str) -> Mask:
    """The selection. Raises StippleError where it is empty: "nothing is selected to …"."""
    selected = cloud.selection()
    if selected.count() == 0:
        raise StippleError(
            f"{cloud.name}: nothing is selected to {verb}; select some splats that are shown and unlocked."
        )
    return selected
