# SPDX-License-Identifier: GPL-3.0-or-later
"""One viewport's picture with *rays*: sorted by the worker's thread, drawn in the interface's.

Blender's gpu module may only be used while Blender draws, so drawing cannot leave the interface's thread. Sorting can:
a redraw takes the order of the view it draws if the worker has it in time, else that of the view before, and never an
older one. What accumulates takes one sample per redraw.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import TYPE_CHECKING

from ..engine.errors import Cancelled, StippleError
from ..engine.progress import Progress
from .viewport import COARSEST, WAIT, Aim, ViewportSession
from .viewport_rhythm import SHOW_INTERVAL

if TYPE_CHECKING:
    from ..engine.rays.order import DrawOrder
    from ..engine.renderer import Renderer

LONGEST_SORT = 5.0  # [s] that a redraw waits for the order of the view before; then the picture stays as it is


class RaysViewportSession(ViewportSession):
    """A session whose worker sorts and whose redraws render."""

    gives_way = False  # samples are the interface's own work

    def __init__(self, redraw: Callable[[], None]) -> None:
        super().__init__(redraw)
        self._order: tuple[Aim, DrawOrder] | None = None
        self._ordered = threading.Condition()
        self._before: Aim | None = None  # what was aimed at before `aim`
        self._drawn_with: Aim | None = None  # whose order the picture has
        self._asked = False  # for the redraw that goes on with the work
        self._failed: Aim | None = None

    @property
    def is_sorted(self) -> bool:
        """Whether there is any order yet."""
        return self._order is not None

    # The interface's thread

    def aim_at(self, aim: Aim) -> bool:
        before = self.aim
        if not super().aim_at(aim):
            return False
        self._before = before
        return True

    def wait_a_moment(self) -> None:
        """Nothing: `render` waits for the order."""

    def render(self, renderer: Renderer) -> None:
        """One piece of work, in a redraw: a small picture or one sample. `renderer` draws on Blender's gpu module."""
        self._asked = False
        aim = self.aim
        ordered = None if aim is None or self.closed or self._failed == aim else self._order_for(aim)
        if ordered is None:
            return
        if self._drawn_with != ordered[0]:
            self._small = self._frame = self._finished = None  # what was drawn with an order that is stale now
        self._drawn_with = ordered[0]
        if super().due() != 0.0:
            return
        try:
            renderer.raster().given_order = ordered[1]
        except StippleError as error:
            self.fail(aim, str(error))
            return
        try:
            with self._about_to_take():
                super().step(renderer, lambda: False)
        except StippleError as error:  # the CPU's memory; there is no other device to try
            self.fail(aim, str(error))

    def close(self) -> None:
        super().close()
        with self._ordered:
            self._order = None
            self._ordered.notify_all()

    def fail(self, aim: Aim | None, text: str) -> None:
        self._failed = aim
        super().fail(aim, text)

    def _is_worth_showing(self, samples: int, noisy: bool) -> bool:
        """The redraw is there anyway: it makes the sample."""
        return time.monotonic() - self._shown_at > SHOW_INTERVAL

    def _order_for(self, aim: Aim) -> tuple[Aim, DrawOrder] | None:
        """The order of this view, or of the one before where this one's is late; None while there is none."""
        before = self._before
        if before is not None and before.scene is not aim.scene:
            before = None
        with self._ordered:
            self._ordered.wait_for(lambda: self._is_ordered(aim), WAIT)
            if not self._is_ordered(aim) and before is not None and self._order is not None:
                self._ordered.wait_for(lambda: self._is_ordered(aim) or self._is_ordered(before), LONGEST_SORT)
            return self._order if self._is_ordered(aim) or self._is_ordered(before) else None

    def _is_ordered(self, aim: Aim | None) -> bool:
        return self._order is not None and self._order[0] == aim

    # The worker's thread

    def due(self) -> float | None:
        """Seconds until the worker has something to do: to sort, or to ask for the redraw that goes on."""
        aim = self.aim
        if aim is None or self.closed or self._failed == aim:
            return None
        if not self._is_ordered(aim):
            return 0.0
        if self._asked:
            return None
        return super().due() if self._drawn_with == aim else 0.0

    def urgent(self) -> bool:
        return self.due() == 0.0 and not self._is_ordered(self.aim)

    def step(self, renderer: Renderer, interrupted: Callable[[], bool]) -> None:
        """Sorts for the newest aim, and asks for the redraw that shows it or goes on."""
        aim = self.aim
        if aim is None or self.closed:
            return
        if not self._is_ordered(aim):
            from ..engine.rays.order import find_order
            from ..engine.timing import StageTimer

            # One order for pictures of all sizes: a splat's filter reaches farthest in the coarsest one's pixels, and
            # takes the least opacity away in the finest one's.
            camera = aim.view.camera(COARSEST)
            timer, progress = StageTimer(renderer.device), self._saying(self._unless_ended(interrupted))
            shot = renderer.shot(aim.scene, camera, aim.settings, timer, progress)
            order = find_order(shot, finest_px=1.0 / COARSEST)
            with self._ordered:
                self._order = (aim, order)
                self._ordered.notify_all()
        self._asked = True
        self.redraw()

    def _unless_ended(self, interrupted: Callable[[], bool]) -> Progress:
        def progress(fraction: float, text: str) -> None:
            if self.closed or interrupted():
                raise Cancelled

        return progress
