# SPDX-License-Identifier: GPL-3.0-or-later
"""One viewport's picture in progress: what it is aimed at, what of it is done.

The interface's thread aims the session and takes pictures; the worker's thread calls `step`, one launch sequence at a
time. While the aim changes, a small picture is made of each; when it rests, samples of the full size accumulate up to
the limit, and then nothing happens until the aim changes again. Knows neither windows nor Blender's data.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from ..engine.errors import Cancelled, DeviceError, StippleError
from ..engine.giving_way import giving_way
from ..engine.progress import Progress
from ..engine.scene import Scene
from ..engine.settings import Settings
from .shown_picture import ShownPicture, place_of
from .view_camera import ViewportView
from .viewport_rhythm import is_worth_showing

if TYPE_CHECKING:
    from ..engine.renderer import Frame, Renderer

REST = 0.12  # [s] without a change before the full size is begun: launches take up to 0.2 s and cannot be interrupted
DRAWN_BY = 1.0  # [s] the full size waits for the small picture to be drawn: on a CPU both would fight for the cores
SLOW, FAST = 0.06, 0.012  # [s] a first picture may take at most, and below which one of twice the size is tried
COARSEST = 4  # divider of the size: below a quarter, projecting and sorting cost more than pixels
WAIT, LONGEST_WAIT = 0.04, 0.1  # [s] a redraw may wait for the picture of the new view, which moves with the overlays
LONG = 0.5  # [s] after which a frame that is not begun yet says what it is doing
SAY_INTERVAL = 0.25  # [s] between such words: each is a redraw
POINTS_PER_LAUNCH = 1 << 20  # [max_points] so that a launch ends soon after the aim changed


@dataclass(frozen=True)
class Aim:
    """All that a viewport's picture depends on; a Scene is compared by identity."""

    scene: Scene
    view: ViewportView
    settings: Settings
    working_space: str


class ViewportSession:
    """The life of one viewport. `redraw` is called from the worker's thread when there is something new to draw."""

    gives_way = True  # to the interface, which does not wait for samples

    def __init__(self, redraw: Callable[[], None]) -> None:
        self.aim: Aim | None = None
        self.picture: ShownPicture | None = None
        self.message = ""
        self.notice = ""  # shown beside the figures
        self.closed = False
        self.divider = COARSEST  # adapts to the machine and the scene
        self.redraw_seconds = 0.0  # that Blender takes to redraw its window, the last times
        self._redraw: Callable[[], None] | None = redraw
        self._lock = threading.RLock()  # a redraw may drop the last reference to the engine, which closes the session
        self._aimed_at = 0.0
        self._small: Aim | None = None  # the aim that a small picture was made of
        self._frame: tuple[Aim, Frame] | None = None
        self._finished: Aim | None = None
        self._shown_at = 0.0
        self._shown_samples = 0
        self._first_seconds = 0.0  # from a change to the first picture of it, the last time
        self._shown = threading.Event()
        self._drawn: ShownPicture | None = None
        self._is_taking = False

    # The interface's thread

    def aim_at(self, aim: Aim) -> bool:
        """Sets what to show; returns whether that is new. What is in progress for another aim stops soon."""
        if aim == self.aim:
            return False
        self._shown.clear()
        self.aim, self._aimed_at = aim, time.monotonic()
        return True

    def wait_a_moment(self) -> None:
        """Waits for the first picture of a new aim where it will be there in time for this redraw.

        Waiting a little longer is better than another redraw where redraws are slow.
        """
        wait = min(max(WAIT, self.redraw_seconds / 2), LONGEST_WAIT)
        if self._first_seconds < 1.5 * wait:
            with self._about_to_take():
                self._shown.wait(wait)

    @contextmanager
    def _about_to_take(self) -> Iterator[None]:
        """In a redraw, before `take`: pictures that come meanwhile ask for no redraw of their own."""
        with self._lock:
            self._is_taking = True
        try:
            yield
        finally:
            with self._lock:
                self._is_taking = False

    def take(self) -> ShownPicture | None:
        """The newest picture, to be drawn now; the worker is to be woken when `due` says so."""
        self._drawn = self.picture
        return self._drawn

    def close(self) -> None:
        """Never blocks for longer than a redraw tag; the worker drops the session at its next launch."""
        with self._lock:
            self._redraw = None
        self.closed, self.aim, self.picture, self._drawn = True, None, None, None

    def status(self) -> str:
        """One line for the viewport's text."""
        picture = self.picture
        if self.message or picture is None:
            return self.message
        size = "" if picture.divider == 1 else f" | 1/{picture.divider} size"
        samples = f"Sample {picture.samples}/{picture.sample_limit}{size}"
        notice = f" | {self.notice}" if self.notice else ""
        return f"{samples} | {picture.splats_visible:,} splats | {picture.seconds * 1000:.0f} ms{notice}"

    # The worker's thread

    def due(self) -> float | None:
        """Seconds until there is work; None when there is none before the aim changes."""
        aim = self.aim
        if aim is None or self.closed or self._finished == aim:
            return None
        if self.divider == 1 or self._wants_small(aim) or self._is_begun(aim):
            return 0.0
        now = time.monotonic()
        if self.picture is not self._drawn and now < self._shown_at + DRAWN_BY:
            return self._shown_at + DRAWN_BY - now  # or until `take`
        return max(0.0, self._aimed_at + REST - now)

    def urgent(self) -> bool:
        """Whether the user is waiting for a first picture of what has changed."""
        aim = self.aim
        if aim is None or self._finished == aim:
            return False
        return self._wants_small(aim) or (self.divider == 1 and not self._is_begun(aim))

    def step(self, renderer: Renderer, interrupted: Callable[[], bool]) -> None:
        """One piece of work: a small picture or one sample. Ends early when the aim changes or `interrupted()`.

        A problem that the user can mend becomes the message and ends work on this aim; nothing is raised.
        """
        aim = self.aim
        if aim is None or self.closed:
            return

        small = self._wants_small(aim)
        # What is quick is finished and shown though the aim has moved on: under a steady drag nothing else would be.
        patient = small or (self.divider == 1 and not self._is_begun(aim))

        def is_over() -> bool:
            return self.closed or interrupted() or not (patient or self.aim == aim)

        def progress(fraction: float, text: str) -> None:
            if is_over():
                raise Cancelled

        try:
            if small:
                self._show_small(aim, renderer, progress)
            else:
                with nullcontext() if patient or not self.gives_way else giving_way(is_over):
                    self._add_sample(aim, renderer, progress)
        except Cancelled:
            self._frame = None
        except DeviceError:
            self._frame = None  # the worker may have another device
            raise
        except StippleError as error:
            self.fail(aim, str(error))
        except MemoryError:
            self.fail(aim, "Stipple ran out of memory; make the viewport smaller or hide some captures.")

    def fail(self, aim: Aim | None, text: str) -> None:
        """Shows a sentence in place of the picture's figures and rests until the aim changes."""
        self._frame, self._finished = None, aim
        self.say(text)

    def say(self, text: str) -> None:
        """Shows a line of status now."""
        if text != self.message:
            self.message = text
            self.redraw()

    def redraw(self) -> None:
        with self._lock:  # close() may run at the same time, and after it Blender's engine is gone
            if self._redraw is not None:
                self._redraw()

    def _is_begun(self, aim: Aim) -> bool:
        return self._frame is not None and self._frame[0] == aim

    def _wants_small(self, aim: Aim) -> bool:
        return self.divider > 1 and self._small != aim

    def _show_small(self, aim: Aim, renderer: Renderer, progress: Progress) -> None:
        divider = self.divider
        begin = time.perf_counter()
        # Points are noisy, and a moving view has no time for more than one sample: the pictures before help.
        settings = replace(aim.settings, supersampling=1, reprojection=aim.settings.method == "points")
        frame = self._begin(aim, renderer, divider, settings, progress)
        frame.render_sample(0)
        seconds = time.perf_counter() - begin
        self._small = aim
        self._show(aim, frame, divider, seconds, 1)
        if seconds > SLOW:
            self.divider = min(divider * 2, COARSEST)
        elif seconds < FAST:
            self.divider = divider // 2

    def _add_sample(self, aim: Aim, renderer: Renderer, progress: Progress) -> None:
        begin = time.perf_counter()
        if self._frame is None or self._frame[0] != aim:
            self._frame = (aim, self._begin(aim, renderer, 1, aim.settings, progress))
        frame = self._frame[1]
        frame.render_sample(frame.film.samples)
        seconds = time.perf_counter() - begin
        samples = frame.film.samples
        done = samples >= frame.sample_count
        if samples == 1 and self.divider == 1 and seconds > SLOW:
            self.divider = 2
        if done or samples == 1 or self._is_worth_showing(samples, noisy=aim.settings.method == "points"):
            self._show(aim, frame, 1, seconds, frame.sample_count)
            self._shown_samples = samples
        if done:
            self._finished, self._frame = aim, None

    def _is_worth_showing(self, samples: int, noisy: bool) -> bool:
        since = time.monotonic() - self._shown_at
        return is_worth_showing(samples, self._shown_samples, since, self.redraw_seconds, noisy)

    def _begin(self, aim: Aim, renderer: Renderer, divider: int, settings: Settings, progress: Progress) -> Frame:
        from ..engine.renderer import Frame

        self._frame = None  # its buffers are about to be used again
        max_points = POINTS_PER_LAUNCH if not renderer.device.is_cuda else 1 << 24
        settings = replace(settings, max_points=max_points, point_scale=1 / divider)
        return Frame(renderer, aim.scene, aim.view.camera(divider), settings, self._saying(progress))

    def _saying(self, progress: Progress) -> Progress:
        """`progress`, and words to the user when it takes long to begin: a large capture is read.

        Later the figures of the picture say more, and each word would be a redraw that keys wait for.
        """
        begun = said = time.monotonic()

        def saying(fraction: float, text: str) -> None:
            nonlocal said
            progress(fraction, text)
            now = time.monotonic()
            if self._frame is None and now > begun + LONG and now > said + SAY_INTERVAL:
                said = now
                self.say(f"{text[:1].upper()}{text[1:]} {fraction:.0%}")

        return saying

    def _show(self, aim: Aim, frame: Frame, divider: int, seconds: float, limit: int) -> None:
        light = frame.resolve_light(aim.working_space)
        self.message = ""
        self.picture = ShownPicture(
            rgba=light.rgba.copy(),  # which the next picture overwrites
            place=place_of(aim.view, divider),
            divider=divider,
            samples=light.samples,
            sample_limit=limit,
            splats_visible=light.stats.splats_visible,
            seconds=seconds,
        )
        self._shown_at = time.monotonic()
        if aim == self.aim and not self._shown.is_set():
            self._first_seconds = self._shown_at - self._aimed_at
            self._shown.set()
        with self._lock:
            is_taken = self._is_taking
        if not is_taken:
            self.redraw()
