# SPDX-License-Identifier: GPL-3.0-or-later
"""Numbered files and which of them a frame shows."""

from __future__ import annotations

from pathlib import Path

import pytest

from stipple.engine.errors import StippleError
from stipple.engine.formats.sequence import Playback, find_numbered, is_numbered, name_of_sequence


def touch(folder: Path, *names: str) -> None:
    for name in names:
        (folder / name).touch()


def places(length: int, first: int, last: int, **playback: object) -> list[int | None]:
    play = Playback(**playback)  # type: ignore[arg-type]
    return [play.place(frame, length) for frame in range(first, last + 1)]


def test_files_are_found_by_their_number_whatever_the_padding(tmp_path: Path) -> None:
    touch(tmp_path, "walk.0001.ply", "walk.0003.ply", "walk.10.ply", "walk.0003.txt", "walk.ply", "walk.00x.ply")
    touch(tmp_path, "talk.0002.ply", "walk.0002.ply.bak", "Xwalk.0002.ply", "walk.0001b.ply")
    found = find_numbered(tmp_path / "walk.0001.ply")
    assert found.numbers == (1, 3, 10) and (found.length, found.missing) == (10, 7)
    assert found == find_numbered(tmp_path / "walk.0777.ply")
    assert found.at(0) == (1, tmp_path / "walk.0001.ply") == found.at(1)
    assert found.at(2)[0] == found.at(8)[0] == 3 and found.at(9) == (10, tmp_path / "walk.10.ply")


@pytest.mark.parametrize(
    ("name", "others", "numbers"),
    [
        ("7.ply", ("12.ply", "x.ply"), (7, 12)),
        ("take2_0005.ply", ("take2_0006.ply", "take3_0007.ply"), (5, 6)),
        ("frame12_splats.ply", ("frame13_splats.ply", "frame13_points.ply"), (12, 13)),
        ("a(1)+[x].5.ply", ("a(1)+[x].6.ply",), (5, 6)),
        ("two\nlines1.ply", ("two\nlines2.ply",), (1, 2)),
    ],
)
def test_the_last_number_counts(tmp_path: Path, name: str, others: tuple[str, ...], numbers: tuple[int, ...]) -> None:
    touch(tmp_path, name, *others)
    assert is_numbered(name) and find_numbered(tmp_path / name).numbers == numbers


def test_what_is_no_sequence_is_said(tmp_path: Path) -> None:
    touch(tmp_path, "koala.ply")
    assert not is_numbered("koala.ply")
    with pytest.raises(StippleError, match=r"the name has no number; a sequence has names such as koala\.0001\.ply"):
        find_numbered(tmp_path / "koala.ply")
    with pytest.raises(StippleError, match="no file of the sequence is there"):
        find_numbered(tmp_path / "walk.0001.ply")
    with pytest.raises(StippleError, match=r"gone.*cannot be read \(No such file or directory\)"):
        find_numbered(tmp_path / "gone" / "walk.0001.ply")


def test_what_is_shown_outside_the_range() -> None:
    assert places(3, -1, 6, start=2, loop="extend") == [0, 0, 0, 0, 1, 2, 2, 2]
    assert places(3, -1, 6, start=2, loop="clip") == [None, None, None, 0, 1, 2, None, None]
    assert places(3, -1, 6, start=2, loop="repeat") == [0, 1, 2, 0, 1, 2, 0, 1]
    assert places(3, -1, 6, start=2, loop="ping_pong") == [1, 2, 1, 0, 1, 2, 1, 0]
    assert all(places(1, -2, 2, start=0, loop=loop) == [0] * 5 for loop in ("extend", "repeat", "ping_pong"))


def test_slow_fast_and_backwards() -> None:
    assert places(3, 1, 7, speed=0.5) == [0, 0, 1, 1, 2, 2, 2]
    assert places(9, 1, 4, speed=2.5) == [0, 2, 5, 7]
    assert places(3, 0, 5, speed=-1.0) == [2, 2, 1, 0, 0, 0]
    assert places(3, 1, 7, speed=-0.5) == [2, 2, 1, 1, 0, 0, 0]
    assert places(3, 1, 4, speed=-1.0, loop="repeat") == [2, 1, 0, 2]
    assert places(5, 1, 3, speed=0.0, offset=3) == [3, 3, 3]
    assert places(5, 1, 3, offset=-1, loop="repeat") == [4, 0, 1]


def test_rounding_leaves_no_file_out() -> None:
    """0.1 · 30 is below 3 in floating point."""
    assert places(11, 1, 101, speed=0.1)[::10] == list(range(11))
    assert places(31, 1, 31, speed=1 / 3 * 3) == list(range(31))


def test_frames_may_be_fractional() -> None:
    play = Playback(start=1.0, speed=2.0)
    assert [play.place(frame, 9) for frame in (1.0, 1.49, 1.5, 2.25, 2.5)] == [0, 0, 1, 2, 3]


@pytest.mark.parametrize(
    ("file", "name"),
    [
        ("walk.0001.ply", "walk"),
        ("take2_05.ply", "take2"),
        ("12.ply", "12"),
        ("f7_b.ply", "f_b"),
        ("koala.ply", "koala"),
    ],
)
def test_a_sequence_has_a_name_without_its_number(file: str, name: str) -> None:
    assert name_of_sequence(file) == name
