# SPDX-License-Identifier: GPL-3.0-or-later
"""Animations in the background: resuming as Blender users do, being stopped, and failing, frame by frame."""

from __future__ import annotations

import os
import signal
from collections.abc import Iterator
from pathlib import Path

import bpy
import pytest

from stipple.addon.render_engine import Progress

from .captures import add_camera, pixels_of, use_stipple
from .numbered import import_sequence, write_numbered

pytestmark = pytest.mark.blender
LAST = 5


@pytest.fixture
def frames(tmp_path: Path) -> Path:
    """The folder that frames 1 … 5 of a moving capture will be in; they are not rendered yet."""
    b_scene = use_stipple(method="POINTS")
    add_camera()
    import_sequence(write_numbered(tmp_path))
    b_scene.frame_start, b_scene.frame_end = 1, LAST
    b_scene.render.image_settings.file_format = "PNG"
    b_scene.render.use_overwrite, b_scene.render.use_placeholder = False, True
    b_scene.render.filepath = str(tmp_path / "out") + os.sep
    return tmp_path / "out"


def render_all() -> None:
    bpy.ops.render.render(animation=True)


def sizes(frames: Path) -> dict[str, int]:
    return {path.name: path.stat().st_size for path in sorted(frames.iterdir())}


def numbers(frames: Path) -> list[int]:
    return [int(path.stem) for path in sorted(frames.glob("*.png"))]


def pictures(frames: Path) -> list[bytes]:
    return [pixels_of(path).tobytes() for path in sorted(frames.glob("*.png"))]


def test_a_second_run_renders_only_what_is_missing(frames: Path) -> None:
    render_all()
    first = pictures(frames)
    assert numbers(frames) == [1, 2, 3, 4, 5] and len(set(first)) == 4  # number 4 is missing and holds 3
    (frames / "0002.png").unlink()
    before = {path.name: path.stat().st_mtime_ns for path in frames.iterdir()}
    render_all()
    assert pictures(frames) == first
    assert {name: (frames / name).stat().st_mtime_ns for name in before} == before


def test_placeholders_share_frames_among_machines(frames: Path) -> None:
    """Another machine's placeholder is an empty file: the frame is its own to finish."""
    frames.mkdir()
    for number in (1, 4):
        (frames / f"{number:04d}.png").touch()
    render_all()
    assert [name for name, size in sizes(frames).items() if not size] == ["0001.png", "0004.png"]
    bpy.context.scene.render.use_overwrite = True
    render_all()
    assert min(sizes(frames).values()) > 100


@pytest.fixture
def interrupts() -> Iterator[None]:
    """Python's own handler of SIGINT, also where a shell started this process in the background and ignores it."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


class InterruptedInFrame3(Progress):
    """Ctrl-C when the frame is half done."""

    def __call__(self, fraction: float, text: str) -> None:
        super().__call__(fraction, text)
        if bpy.context.scene.frame_current == 3 and fraction > 0.3:
            os.kill(os.getpid(), signal.SIGINT)


@pytest.mark.parametrize("stopped_by", ["interrupt", "damaged file"])
@pytest.mark.usefixtures("interrupts")
def test_what_is_done_stays_and_a_second_run_goes_on(
    frames: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, stopped_by: str
) -> None:
    render_all()
    whole = pictures(frames)
    for path in frames.iterdir():
        path.unlink()
    third = tmp_path / "walk" / "walk.0003.ply"
    good = third.read_bytes()
    with monkeypatch.context() as only_here:
        if stopped_by == "interrupt":
            only_here.setattr("stipple.addon.render_engine.Progress", InterruptedInFrame3)
        else:
            third.write_bytes(good[:-9])
        with pytest.raises(RuntimeError, match="interrupted" if stopped_by == "interrupt" else r"walk\.0003\.ply"):
            render_all()
    assert sorted(sizes(frames)) == ["0001.png", "0002.png"]  # and no placeholder of the third
    assert pictures(frames) == whole[:2]
    third.write_bytes(good)
    render_all()
    assert pictures(frames) == whole
