# SPDX-License-Identifier: GPL-3.0-or-later
"""The one thread that renders for all viewports, and the gate it shares with final renders.

One thread, because kernels must not be compiled twice at once and two accumulations would only slow each other down: it
takes turns, a viewport that waits for a first picture first. It starts with the first viewport and ends with the last.
"""

from __future__ import annotations

import atexit
import logging
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from ..engine.errors import Cancelled, DeviceError, StippleError
from .viewport import Aim, ViewportSession

if TYPE_CHECKING:
    from ..engine.renderer import Renderer

POLL = 0.1  # [s] between looks at whether to give up while waiting for the gate
THREAD_NAME = "stipple-viewport"
log = logging.getLogger(__package__)

Prepare = Callable[[str, str, Callable[[float, str], None]], None]
"""(device, method, progress): loads the kernels, at once where they are loaded; `progress` may raise Cancelled."""


class ViewportWorker:
    """Owns the thread, the sessions and a renderer for each session that has been stepped."""

    def __init__(self, prepare: Prepare) -> None:
        self._prepare = prepare
        self._sessions: list[ViewportSession] = []
        self._renderers: dict[int, tuple[str, Renderer]] = {}  # by id of the session: its device and renderer
        self._fallen: dict[int, str] = {}  # by id of the session: the device that does not serve it
        self._spare: tuple[str, Renderer] | None = None  # of the viewport closed last: undo reopens viewports
        self._changed = threading.Condition()
        self._gate = threading.Lock()  # held while anything of Warp runs
        self._stopping = False
        self._waiting_finals = 0
        self._thread: threading.Thread | None = None
        self._turn = 0

    @property
    def running(self) -> bool:
        return self._thread is not None and self._thread.is_alive()

    @property
    def serves_finals(self) -> bool:
        """Whether a final render runs or waits, and viewports stand still."""
        return self._waiting_finals > 0

    def add(self, session: ViewportSession) -> None:
        """Renders for this session from now on, until it is closed."""
        with self._changed:
            self._sessions.append(session)
            if not self.running:
                self._stopping = False
                self._thread = threading.Thread(target=self._run, name=THREAD_NAME, daemon=True)
                self._thread.start()
                atexit.register(self.stop)
            self._changed.notify()

    def wake(self) -> None:
        """A session has a new aim or was closed."""
        with self._changed:
            self._changed.notify()

    def stop(self) -> None:
        """Closes all sessions, waits for the launch in progress, ends the thread and frees the renderers."""
        atexit.unregister(self.stop)
        with self._changed:
            self._stopping = True
            for session in self._sessions:
                session.close()
            self._sessions.clear()
            self._changed.notify()
        if self._thread is not None and self._thread is not threading.current_thread():
            self._thread.join()
        self._thread = None
        self._fallen.clear()
        while self._renderers:
            self._renderers.popitem()[1][1].free()
        if self._spare is not None:
            self._spare[1].free()
            self._spare = None

    @contextmanager
    def final_render(self, checkpoint: Callable[[], None]) -> Iterator[None]:
        """Holds the device for a final render: viewports pause after the launch in progress and go on afterwards.

        `checkpoint` is called while waiting and may raise Cancelled.
        """
        self._waiting_finals += 1
        try:
            while not self._gate.acquire(timeout=POLL):
                checkpoint()
            try:
                yield
            finally:
                self._gate.release()
        finally:
            self._waiting_finals -= 1
            self.wake()

    def _run(self) -> None:
        while True:
            with self._changed:
                session = self._next()
                while session is None and not self._stopping:
                    self._drop_closed()
                    if not self._sessions:
                        break
                    self._changed.wait(self._pause())
                    session = self._next()
                if session is None:
                    self._thread = None
                    return
            with self._gate:
                self._step(session)

    def _next(self) -> ViewportSession | None:
        """The session whose turn it is: of those with work now, one that waits for its first picture, else in turn."""
        if self._stopping or self._waiting_finals:
            return None
        ready = [session for session in self._sessions if session.due() == 0.0]
        urgent = [session for session in ready if session.urgent()]
        self._turn += 1
        chosen = urgent or ready
        return chosen[self._turn % len(chosen)] if chosen else None

    def _pause(self) -> float | None:
        """Seconds until some session has work; None when only a change brings work."""
        if self._waiting_finals:
            return None
        times = [due for session in self._sessions if (due := session.due()) is not None]
        return min(times) if times else None

    def _drop_closed(self) -> None:
        for session in [session for session in self._sessions if session.closed]:
            self._sessions.remove(session)
            self._fallen.pop(id(session), None)
            held = self._renderers.pop(id(session), None)
            if held is not None:
                if self._spare is not None:
                    self._spare[1].free()
                self._spare = held

    def _step(self, session: ViewportSession) -> None:
        aim = session.aim
        try:
            if aim is not None and not session.closed:
                session.step(self._renderer_for(session, aim.settings.device, aim.settings.method), self._interrupted)
        except Cancelled:
            pass
        except (DeviceError, RuntimeError) as error:
            self._fall_back(session, aim, error)
        except StippleError as error:
            session.fail(aim, str(error))
        except Exception as error:
            self._fail_unexpectedly(session, aim, error)

    def _fall_back(self, session: ViewportSession, aim: Aim | None, error: Exception) -> None:
        """The CPU renders for this session from now on, until another device is chosen; on the CPU the error counts."""
        from ..engine.device import is_cpu

        device = "cpu" if aim is None or id(session) in self._fallen else aim.settings.device
        if not is_cpu(device):
            held = self._renderers.pop(id(session), None)
            if held is not None:
                held[1].free()
            self._fallen[id(session)] = device
            session.notice = f"{error} The CPU renders instead."
            log.warning(session.notice)
        elif isinstance(error, StippleError):
            session.fail(aim, str(error))
        else:
            self._fail_unexpectedly(session, aim, error)

    def _fail_unexpectedly(self, session: ViewportSession, aim: Aim | None, error: Exception) -> None:
        log.error("Unexpected error in the viewport", exc_info=error)
        session.fail(aim, f"Stipple: {type(error).__name__}: {error} (details are in the console)")

    def _interrupted(self) -> bool:
        return self._stopping or self.serves_finals

    def _renderer_for(self, session: ViewportSession, device: str, method: str) -> Renderer:
        def progress(fraction: float, text: str) -> None:
            if session.closed or self._interrupted():
                raise Cancelled
            session.say(text.capitalize())

        if self._fallen.get(id(session)) == device:
            device = "cpu"
        elif self._fallen.pop(id(session), None):
            session.notice = ""
        self._prepare(device, method, progress)
        if method == "rays":
            self._prepare("cpu", method, progress)  # of the film, which redraws add to
        from ..engine.renderer import Renderer

        held = self._renderers.pop(id(session), None)
        if held is None:
            held, self._spare = self._spare, None
        if held is not None and held[0] != device:
            held[1].free()
            held = None
        held = held or (device, Renderer(device))
        self._renderers[id(session)] = held
        return held[1]
