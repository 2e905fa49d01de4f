# SPDX-License-Identifier: GPL-3.0-or-later
"""The steps of a session by what the datablock holds after each: where Blender's undo has gone, a session follows.

Read again from the datablock, splats would be the same, but not what is under their paint.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..content_keys import CloudKey

if TYPE_CHECKING:
    from ...engine.edit.editable_cloud import EditableCloud
    from ...engine.edit.step import Step

MOST_BYTES = 256 << 20  # of steps; a session whose steps take more forgets the oldest


class SessionHistory:
    """The engine's `History` of one cloud, and a key for each of its positions.

    Steps that change flags only are not in it: the datablock has the flags.
    """

    def __init__(self, cloud: EditableCloud, key: CloudKey) -> None:
        """`key` is of the datablock as it was read."""
        from ...engine.edit.history import History

        self._history = History(cloud, MOST_BYTES)
        self._keys = {0: key}  # by position

    def record(self, step: Step, key: CloudKey) -> None:
        """A step that was done, and the key of what has been written then."""
        history = self._history
        if step.nbytes > MOST_BYTES:
            history.clear()
            self._keys = {history.position: key}
            return
        history.record(step)
        reached = range(history.first_position, history.position)
        self._keys = {position: known for position, known in self._keys.items() if position in reached}
        self._keys[history.position] = key

    def go_to(self, key: CloudKey) -> bool:
        """Brings the cloud's arrays to where the key was; False, and nothing done, where no position had it."""
        here = self._history.position
        found = [position for position, known in self._keys.items() if known == key]
        if not found:
            return False
        self._history.go_to(min(found, key=lambda position: abs(position - here)))
        return True
