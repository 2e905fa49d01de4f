# SPDX-License-Identifier: GPL-3.0-or-later
"""Delete and restore, hide and reveal, lock and unlock: each flips one flag, so each is one bit per splat to undo.

Reveal selects what it shows, as Blender's does, and flips two.
"""

from __future__ import annotations

from ..errors import StippleError
from .editable_cloud import EditableCloud
from .mask import Mask, mask_from_state
from .selection import selected_or_refuse
from .state import DELETED, HIDDEN, LOCKED, SELECTED, SEPARATED
from .step import FlagDiff, Step, flag_step


def delete(cloud: EditableCloud, which: Mask | None = None) -> Step:
    """The step that deletes the selection, or of `which` what is shown and unlocked.

    Deleted splats keep their data until the cloud is written back (`EditableCloud.to_cloud` leaves them out).
    Raises StippleError when nothing is selected.
    """
    chosen = selected_or_refuse(cloud, "delete") if which is None else which & cloud.selectable()
    return flag_step("Delete", DELETED, chosen)


def keep_only(cloud: EditableCloud) -> Step:
    """The step that deletes what is shown, unlocked and not selected.

    Raises StippleError when nothing is selected, or everything.
    """
    return flag_step("Keep Only", DELETED, _unselected(cloud, "keep", "delete"))


def restore(cloud: EditableCloud, which: Mask | None = None) -> Step:
    """The step that brings back deleted splats, of `which` only if given; not those that became another capture.

    Raises StippleError when none are deleted.
    """
    deleted = mask_from_state(cloud.state, DELETED, SEPARATED)
    return _clear(cloud, "Restore", DELETED, deleted if which is None else deleted & which, "no splats are deleted")


def hide(cloud: EditableCloud, unselected: bool = False) -> Step:
    """The step that hides the selection, or else what is not selected.

    Raises StippleError when nothing is selected, or there is nothing else.
    """
    chosen = _unselected(cloud, "show", "hide") if unselected else selected_or_refuse(cloud, "hide")
    return flag_step("Hide", HIDDEN, chosen)


def reveal(cloud: EditableCloud, select: bool = True) -> Step:
    """The step that shows all hidden splats and selects those that are unlocked, or else leaves them unselected.

    Raises StippleError when none are hidden.
    """
    shown = _clear(cloud, "Reveal", HIDDEN, mask_from_state(cloud.state, HIDDEN, DELETED), "no splats are hidden")
    selected = mask_from_state(cloud.state, HIDDEN | SELECTED, DELETED | LOCKED)
    flipped = mask_from_state(cloud.state, HIDDEN, DELETED | LOCKED) - selected if select else selected
    return Step(shown.name, (*shown.diffs, FlagDiff(SELECTED, flipped)), shown.changed)


def lock(cloud: EditableCloud, unselected: bool = False) -> Step:
    """The step that protects the selection, or else what is not selected, from every operation.

    Raises StippleError when nothing is selected, or there is nothing else.
    """
    chosen = _unselected(cloud, "leave unlocked", "lock") if unselected else selected_or_refuse(cloud, "lock")
    return flag_step("Lock", LOCKED, chosen)


def unlock(cloud: EditableCloud) -> Step:
    """The step that unlocks all splats. Raises StippleError when none are locked."""
    return _clear(cloud, "Unlock", LOCKED, mask_from_state(cloud.state, LOCKED, 0), "no splats are locked")


def counts(cloud: EditableCloud) -> dict[str, int]:
    """How many splats are what, for a status line: total, selected, hidden, deleted, separated, locked."""
    return {
        "total": cloud.splat_count,
        "selected": cloud.selection().count(),
        "hidden": mask_from_state(cloud.state, HIDDEN, DELETED).count(),
        "deleted": mask_from_state(cloud.state, DELETED, SEPARATED).count(),
        "separated": mask_from_state(cloud.state, DELETED | SEPARATED, 0).count(),
        "locked": mask_from_state(cloud.state, LOCKED, DELETED).count(),
    }


def _unselected(cloud: EditableCloud, selected_verb: str, verb: str) -> Mask:
    """What is shown, unlocked and not selected. Raises StippleError when nothing is selected, or everything."""
    rest = cloud.selectable() - selected_or_refuse(cloud, selected_verb)
    if rest.count() == 0:
        raise StippleError(f"{cloud.name}: everything is selected, and nothing else is left to {verb}; select less.")
    return rest


def _clear(cloud: EditableCloud, name: str, flag: int, chosen: Mask, problem: str) -> Step:
    step = flag_step(name, flag, chosen)
    if step.changed == 0:
        raise StippleError(f"{cloud.name}: {problem}.")
    return step
