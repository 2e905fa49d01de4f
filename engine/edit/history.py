# SPDX-License-Identifier: GPL-3.0-or-later
"""What was done to a cloud, so that it can be undone and done again, bit by bit, within a bounded memory."""

from __future__ import annotations

from ..errors import StippleError
from .editable_cloud import EditableCloud
from .step import Step

DEFAULT_LIMIT_BYTES = 1 << 30


class History:
    """The steps of one cloud, oldest first, and how many of them are done.

    Doing something after an undo drops the steps that were undone (branches are not kept). When the steps take more
    than `limit_bytes`, the oldest are dropped; the newest always stays: memory is bounded by the limit and one step.

    Steps count from 0 and keep their numbers when older ones are dropped: `position` is the number of the next step, so
    that a host with an undo stack of its own (Blender's) can remember a position and go back to it with `go_to`.
    """

    def __init__(self, cloud: EditableCloud, limit_bytes: int = DEFAULT_LIMIT_BYTES) -> None:
        self.cloud = cloud
        self._limit_bytes = limit_bytes
        self._steps: list[Step] = []
        self._done = 0  # of _steps
        self._dropped = 0  # steps that left at the old end
        self._nbytes = 0

    @property
    def position(self) -> int:
        """Number of steps ever done and not undone."""
        return self._dropped + self._done

    @property
    def first_position(self) -> int:
        """The farthest `go_to` can go back."""
        return self._dropped

    @property
    def last_position(self) -> int:
        """The farthest `go_to` can go forward."""
        return self._dropped + len(self._steps)

    @property
    def nbytes(self) -> int:
        """Memory of all steps [bytes]."""
        return self._nbytes

    @property
    def limit_bytes(self) -> int:
        return self._limit_bytes

    @limit_bytes.setter
    def limit_bytes(self, limit: int) -> None:
        self._limit_bytes = limit
        self._drop_oldest()

    @property
    def steps(self) -> tuple[Step, ...]:
        """Those that can be undone or redone, oldest first; `undo_step` and `redo_step` are next in turn."""
        return tuple(self._steps)

    @property
    def undo_step(self) -> Step | None:
        return self._steps[self._done - 1] if self._done else None

    @property
    def redo_step(self) -> Step | None:
        return self._steps[self._done] if self._done < len(self._steps) else None

    def do(self, step: Step) -> bool:
        """Apply a step and record it; False, and nothing recorded, where it changes no splat.

        When applying fails, cloud and history are as before and the error goes on.
        """
        if step.changed == 0:
            return False
        step.apply(self.cloud)
        self.record(step)
        return True

    def record(self, step: Step) -> None:
        """Record a step whose changes are already in the cloud (a stroke's)."""
        self._nbytes += step.nbytes - sum(undone.nbytes for undone in self._steps[self._done :])
        self._steps[self._done :] = [step]
        self._done += 1
        self._drop_oldest()

    def undo(self) -> Step:
        """Revert the last step done and return it. Raises StippleError when there is none."""
        step = self.undo_step
        if step is None:
            raise StippleError(f"{self.cloud.name}: there is nothing to undo.")
        step.revert(self.cloud)
        self._done -= 1
        return step

    def redo(self) -> Step:
        """Apply the last step undone and return it. Raises StippleError when there is none."""
        step = self.redo_step
        if step is None:
            raise StippleError(f"{self.cloud.name}: there is nothing to redo.")
        step.apply(self.cloud)
        self._done += 1
        return step

    def go_to(self, position: int) -> None:
        """Undo or redo until `position` steps are done. Raises StippleError, with nothing changed, out of range."""
        if not self.first_position <= position <= self.last_position:
            raise StippleError(
                f"{self.cloud.name}: step {position} is no longer in the editing history (steps "
                f"{self.first_position} to {self.last_position} are); raise the undo memory limit."
            )
        while self.position > position:
            self.undo()
        while self.position < position:
            self.redo()

    def clear(self) -> None:
        """Forget all steps; the cloud stays as it is."""
        self._dropped = self.position
        self._steps.clear()
        self._done = self._nbytes = 0

    def _drop_oldest(self) -> None:
        """Only steps that are done go: an undone one is what the user may want back next."""
        while self._nbytes > self._limit_bytes and self._done > 0 and len(self._steps) > 1:
            self._nbytes -= self._steps.pop(0).nbytes
            self._done -= 1
            self._dropped += 1
