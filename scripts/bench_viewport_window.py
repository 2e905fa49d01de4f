# SPDX-License-Identifier: GPL-3.0-or-later
"""The part of bench_viewport.py that runs inside Blender's window."""

from __future__ import annotations

import subprocess
import sys
import time
from importlib import import_module
from pathlib import Path
from typing import Any

import bpy

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests" / "desktop"))
from window import PACKAGE, Steps, Window, run, use_stipple

MOVES, PHASE = 15, 12.0  # camera moves of each method; [s] of each phase with key presses
ACCUMULATION = 60.0  # [s] of those while samples add up: few redraws, so many presses are needed to meet some
IDLE = 5.0  # [s] without anything to do
ANSWER, MOVE = "K", "J"
# Real key presses of the X server, at times that no redraw can be in step with; prints when each was sent.
PRESSES = """
import random, subprocess, sys, time
key, least, most, count = sys.argv[1], *map(float, sys.argv[2:])
tool = subprocess.Popen(["xdotool", "-"], stdin=subprocess.PIPE, text=True)
random.seed(5)
for _ in range(int(count)):
    time.sleep(random.uniform(least, most))
    sent = time.monotonic()
    tool.stdin.write(f"key {key}\\n")
    tool.stdin.flush()
    print(sent, flush=True)
tool.stdin.close()
tool.wait()
"""


class Seen:
    """When things happened [s], by the clock that the sender of the keys reads too."""

    def __init__(self) -> None:
        self.answers: list[float] = []
        self.shown: list[float] = []
        self.callbacks: list[float] = []
        self.drawn: list[float] = []
        self.waiting = False


seen = Seen()


class WM_OT_bench_keys(bpy.types.Operator):
    """Notes when Blender hands on a key press; turns the view with one of them."""

    bl_idname, bl_label = "wm.bench_keys", "Bench Keys"

    def invoke(self, context: Any, _event: Any) -> set[str]:
        context.window_manager.modal_handler_add(self)
        return {"RUNNING_MODAL"}

    def modal(self, context: Any, event: Any) -> set[str]:
        if event.value != "PRESS" or event.type not in (ANSWER, MOVE):
            return {"PASS_THROUGH"}
        seen.answers.append(time.monotonic())
        if event.type == MOVE:
            turn(context.region_data)
            context.area.tag_redraw()
            seen.waiting = True
        return {"RUNNING_MODAL"}


def turn(b_region_3d: Any) -> None:
    from mathutils import Quaternion

    b_region_3d.view_rotation = b_region_3d.view_rotation @ Quaternion((0, 1, 0), 0.05)


def watch_drawing() -> None:
    """Notes how long Stipple's part of each redraw takes, and when the picture of a moved view is on the screen."""
    viewport_class = import_module(f"{PACKAGE}.addon.viewport_draw").Viewport
    draw = viewport_class.draw

    def on_screen() -> None:  # a timer, which Blender runs after it has drawn the window
        seen.shown.append(time.monotonic())

    def timed(self: Any, *arguments: Any) -> None:
        begin = time.monotonic()
        draw(self, *arguments)
        seen.callbacks.append(time.monotonic() - begin)
        seen.drawn.append(begin)
        if seen.waiting and self.session._shown.is_set():  # the picture just drawn is of the view just set
            seen.waiting = False
            bpy.app.timers.register(on_screen, first_interval=0.0)

    viewport_class.draw = timed


def press(key: str, least: float, most: float, count: int) -> Any:
    command = ["python3", "-c", PRESSES, key.lower(), str(least), str(most), str(count)]
    return subprocess.Popen(command, stdout=subprocess.PIPE, text=True)


def answers(window: Window, name: str, busy: Any, seconds: float = PHASE, counts: Any = lambda sent: True) -> Steps:
    """Presses keys while `busy()` is called between events; notes how late Blender hands on those that count."""
    seen.answers, seen.callbacks = [], []
    sender = press(ANSWER, 0.1, 0.25, int(seconds / 0.175))

    def ended() -> bool:
        busy()
        return sender.poll() is not None

    begin, begin_cpu = time.monotonic(), time.process_time()
    yield ended
    took = time.monotonic() - begin
    sent = [float(line) for line in sender.stdout]
    since = time.monotonic()
    yield lambda: time.monotonic() - since > 0.5
    if len(sent) != len(seen.answers):
        raise RuntimeError(f"{name}: {len(sent)} keys were pressed and {len(seen.answers)} came")
    frame = window.session._frame
    window.results[name] = {
        "samples_per_second": (frame[1].film.samples if frame else window.session.picture.samples) / took,
        "answer": [at - before for before, at in zip(sent, seen.answers, strict=True) if counts(before)],
        "callback": seen.callbacks,
        "redraws_per_second": len(seen.callbacks) / took,
        "cores": (time.process_time() - begin_cpu) / took,
    }


class Spans:
    """When samples add up: from where the first picture of the full size is drawn to where the last one is.

    *sorted* comes to its last sample; then the view is turned, and what the user waits for is a moved view.
    """

    def __init__(self, window: Window) -> None:
        self._window = window
        self._spans: list[list[float]] = []
        self._open = False

    def look(self) -> None:
        """To be called between events."""
        session, now = self._window.session, time.monotonic()
        picture = session.picture
        is_drawn = session._shown.is_set() and picture is session._drawn and picture.divider == 1  # of this view
        if self._open:
            self._spans[-1][1] = now
        if session.due() is None and is_drawn:
            self._open = False
            turn(self._window.b_region_3d)
            self._window.b_area.tag_redraw()
        elif is_drawn and session._is_begun(session.aim) and not self._open:
            self._open = True
            self._spans.append([now, now])

    def hold(self, sent: float) -> bool:
        return any(begin <= sent <= end for begin, end in self._spans)

    def summary(self) -> dict[str, float]:
        """Over all spans: how many, their seconds, and redraws a second in them."""
        seconds = sum(end - begin for begin, end in self._spans)
        redraws = sum(map(self.hold, seen.drawn))
        return {"spans": len(self._spans), "span_seconds": seconds, "redraws_per_second": redraws / seconds}


def moves(window: Window, name: str, rest: bool = True) -> Steps:
    """Turns the view with a key."""
    if rest:
        yield from window.rest()
    seen.answers, seen.shown = [], []
    sender = press(MOVE, 0.8, 1.4, MOVES)
    yield lambda: sender.poll() is not None
    sent = [float(line) for line in sender.stdout]
    yield lambda: len(seen.answers) == len(sent) and bool(seen.shown) and seen.shown[-1] > seen.answers[-1]
    # A move that the next one overtakes counts until that one is shown.
    shown = [min(at for at in seen.shown if at > moved) for moved in seen.answers]
    window.results[name] = {"shown": [at - before for before, at in zip(sent, shown, strict=True)]}


def measure(window: Window) -> Steps:
    b_scene = use_stipple()
    bpy.ops.import_scene.splats(filepath=sys.argv[-1])
    bpy.context.view_layer.objects.active.select_set(False)
    bpy.utils.register_class(WM_OT_bench_keys)
    override = {"window": window.b_window, "area": window.b_area, "region": window.b_region}
    subprocess.run(["xdotool", "mousemove", "500", "400"], check=True)
    with bpy.context.temp_override(**override):
        bpy.ops.view3d.view_all()
        bpy.ops.wm.bench_keys("INVOKE_DEFAULT")
    window.b_space.shading.type = "RENDERED"
    since = time.monotonic()
    yield lambda: time.monotonic() - since > 1.0
    yield from window.rest()
    watch_drawing()
    with bpy.context.temp_override(**override):
        begin = time.monotonic()
        bpy.ops.wm.redraw_timer(type="DRAW_WIN_SWAP", iterations=10)
    window.results["redraw"] = (time.monotonic() - begin) / 10
    window.results["region"] = [window.b_region.width, window.b_region.height]
    yield from window.rest()
    begin, begin_cpu = time.monotonic(), time.process_time()
    seen.callbacks = []
    yield lambda: time.monotonic() - begin > IDLE
    window.results["idle"] = {"cores": (time.process_time() - begin_cpu) / IDLE, "redraws": len(seen.callbacks)}
    yield from answers(window, "resting", lambda: None)
    last = [0.0]

    def redraw() -> None:
        if time.monotonic() - last[0] > 0.06:
            last[0] = time.monotonic()
            window.b_area.tag_redraw()

    yield from answers(window, "redrawn, nothing to render", redraw)
    for method in ("POINTS", "SORTED"):
        yield from of_method(window, b_scene.stipple, method)


def of_method(window: Window, b_stipple: Any, method: str) -> Steps:
    b_stipple.method = method
    yield from moves(window, f"{method.lower()} at rest, then moved")
    # As many samples as take longer than this; sorted has one for each subpixel.
    b_stipple.viewport_samples, b_stipple.supersampling = 1 << 16, 1 if method == "POINTS" else 16
    window.b_area.tag_redraw()  # which scripts have to ask for
    spans = Spans(window)
    name = f"{method.lower()} accumulating"
    yield from answers(window, name, spans.look, ACCUMULATION, spans.hold)
    window.results[name] |= spans.summary()
    yield from moves(window, f"{method.lower()} accumulating, then moved", rest=False)
    b_stipple.viewport_samples, b_stipple.supersampling = 16, 1


run({"measure": measure})
