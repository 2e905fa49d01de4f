# SPDX-License-Identifier: GPL-3.0-or-later
"""The file of a capture's edits: what was written comes back, and nothing else is taken for it."""

from __future__ import annotations

import json
import os
import re
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from stipple.engine.edit.capture_edits import CaptureEdits
from stipple.engine.edit.edits_file import SUFFIX, read_edits, write_edits
from stipple.engine.errors import StippleError

COUNT = 5_003
MATRICES = np.stack([np.eye(3, 4), np.full((3, 4), 0.1)])


@pytest.fixture
def edits() -> CaptureEdits:
    rng = np.random.default_rng(1)
    rows = np.sort(rng.permutation(COUNT)[:300]).astype(np.int32)
    empty = CaptureEdits("123456 00ff", COUNT)
    flagged = empty.with_states(rng.integers(0, 16, COUNT).astype(np.uint32))
    none = np.zeros(300, bool)
    painted = flagged.with_values("painted_rows", rows, rng.integers(1, 1 << 60, 300).astype(np.uint64), none)
    faint = painted.with_values("opacity_rows", rows[::2], rng.random(150).astype(np.float32), none[::2])
    moved = faint.moved(rows[::3], MATRICES[1])
    return moved.moved(rows[:50], np.column_stack([np.eye(3), np.ones(3)]))


@pytest.fixture
def path(edits: CaptureEdits, tmp_path: Path) -> Path:
    path = tmp_path / f"shot.garden{SUFFIX}"
    write_edits(path, edits, "garden.ply", 3)
    return path


def assert_equal(left: CaptureEdits, right: CaptureEdits) -> None:
    assert (left.capture, left.splat_count, left.token) == (right.capture, right.splat_count, right.token)
    assert left.arrays.keys() == right.arrays.keys()
    for name, array in left.arrays.items():
        assert array.dtype == right.arrays[name].dtype and np.array_equal(array, right.arrays[name]), name


def test_what_was_written_comes_back(path: Path, edits: CaptureEdits) -> None:
    assert len(edits.arrays) == 11
    assert_equal(read_edits(path), edits)
    assert os.listdir(path.parent) == [path.name]


def test_any_program_can_read_it(path: Path, edits: CaptureEdits) -> None:
    with np.load(path, allow_pickle=False) as archive:
        header = json.loads(str(archive["header"]))
        deleted = np.unpackbits(archive["deleted"], count=COUNT, bitorder="little")
    assert header["format"] == "stipple-edits" and header["version"] == 1
    assert header["capture"] == {
        "name": "garden.ply", "bytes": 123456, "samples": "00ff", "splats": COUNT, "sh_degree": 3
    }  # fmt: skip
    assert deleted.sum() == edits.counts["deleted"] == np.count_nonzero(edits.states() & 4)


def test_flags_are_deflated(tmp_path: Path) -> None:
    """A part of a file in a row, as trainers write them, takes next to nothing."""
    states = np.zeros(8_000_000, np.uint32)
    states[1_000_000:3_000_000] = 4
    write_edits(tmp_path / "a.npz", CaptureEdits("1 0", len(states)).with_states(states), "garden.ply", 0)
    assert (tmp_path / "a.npz").stat().st_size < 3_000


def test_no_changed_bit_is_taken_for_an_edit(path: Path, edits: CaptureEdits) -> None:
    """Either it is noticed or it is one that says nothing, such as a date in the archive."""
    good, noticed = path.read_bytes(), 0
    rng = np.random.default_rng(2)
    for place in rng.integers(0, len(good), 200).tolist():
        data = bytearray(good)
        data[place] ^= 1 << int(rng.integers(0, 8))
        path.write_bytes(data)
        try:
            found = read_edits(path)
        except StippleError as error:
            assert str(path) in str(error)
            noticed += 1
        else:
            assert_equal(found, edits)
    assert noticed > 150


@pytest.mark.parametrize("share", [0.01, 0.3, 0.9, 0.999])
def test_a_file_cut_short_is_damaged(path: Path, share: float) -> None:
    os.truncate(path, int(path.stat().st_size * share))
    with pytest.raises(StippleError, match=r"the edits are damaged \(.*\); put an undamaged copy in its place"):
        read_edits(path)


def test_a_file_that_is_missing_or_empty(path: Path) -> None:
    path.write_bytes(b"")
    with pytest.raises(StippleError, match="the file is empty"):
        read_edits(path)
    path.unlink()
    with pytest.raises(StippleError, match="there is no such file"):
        read_edits(path)


def with_header(change: Callable[[dict[str, Any]], object]) -> Callable[[dict[str, Any]], None]:
    def changed(arrays: dict[str, Any]) -> None:
        header = json.loads(str(arrays["header"]))
        change(header)
        arrays["header"] = np.array(json.dumps(header))

    return changed


WRONG = {
    "another format": with_header(lambda h: h.update(format="x")),
    "no format": with_header(lambda h: h.pop("format")),
    "another capture": with_header(lambda h: h["capture"].update(samples="00fe")),
    "more splats": with_header(lambda h: h["capture"].update(splats=COUNT + 8)),
    "no number": with_header(lambda h: h["capture"].update(splats="many")),
    "no header": lambda a: a.pop("header"),
    "a header of numbers": lambda a: a.update(header=np.arange(3)),
    "an array too many": lambda a: a.update(more=np.arange(3)),
    "an array too few": lambda a: a.pop("painted_words"),
    "flags too short": lambda a: a.update(deleted=a["deleted"][:-1]),
    "another type": lambda a: a.update(painted_rows=a["painted_rows"].astype(np.int64)),
    "falling rows": lambda a: a.update(painted_rows=a["painted_rows"][::-1].copy()),
    "rows beyond the end": lambda a: a.update(painted_rows=a["painted_rows"] + np.int32(COUNT)),
    "no such matrix": lambda a: a.update(moved_by=a["moved_by"] + np.int32(9)),
    "matrices that are not finite": lambda a: a.update(matrices=a["matrices"] * np.nan),
    "matrices of another shape": lambda a: a.update(matrices=a["matrices"][:, :2].copy()),
    "one painted opacity changed": lambda a: a["opacity_values"].__setitem__(3, 0.5),
}


@pytest.mark.parametrize("wrong", WRONG)
def test_an_archive_that_is_not_what_it_says_is_damaged(path: Path, wrong: str) -> None:
    with np.load(path) as archive:
        arrays = {name: archive[name] for name in archive.files}
    WRONG[wrong](arrays)
    np.savez(path, **arrays)
    with pytest.raises(StippleError, match="the edits are damaged"):
        read_edits(path)


def test_a_later_version_is_named(path: Path) -> None:
    with np.load(path) as archive:
        arrays = {name: archive[name] for name in archive.files}
    with_header(lambda h: h.update(version=2))(arrays)
    np.savez(path, **arrays)
    with pytest.raises(StippleError, match="another version of Stipple wrote these edits"):
        read_edits(path)


def test_nothing_in_it_is_executed(path: Path) -> None:
    """Nor is anybody told how to."""
    np.savez(path, header=np.array([{"a": 1}], object))
    with pytest.raises(StippleError, match=r"the edits are damaged \(its array 'header' cannot be read\); put an"):
        read_edits(path)


@pytest.mark.parametrize("content", [b"not an archive", b"\x80\x04N.", b"PK"])
def test_a_file_that_is_no_archive_is_damaged(path: Path, content: bytes) -> None:
    path.write_bytes(content)
    expected = f"{path}: the edits are damaged (it is no NumPy archive); put an undamaged copy in its place, or discard"
    with pytest.raises(StippleError, match=re.escape(expected)):
        read_edits(path)


@pytest.mark.parametrize("name", ["header", "deleted.npy"])
def test_a_member_that_is_no_array_is_damage(path: Path, name: str) -> None:
    with zipfile.ZipFile(path) as archive:
        members = {member: archive.read(member) for member in archive.namelist() if member != f"{name}.npy"}
    with zipfile.ZipFile(path, "w") as archive:
        for member, data in (members | {name: b"text"}).items():
            archive.writestr(member, data)
    with pytest.raises(StippleError, match=rf"the edits are damaged \(its '{name.removesuffix('.npy')}' is no array\)"):
        read_edits(path)


def test_a_failed_writing_leaves_the_old_file(path: Path, edits: CaptureEdits, monkeypatch: pytest.MonkeyPatch) -> None:
    before = path.read_bytes()

    def fail(*_: object, **__: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "replace", fail)
    with pytest.raises(StippleError, match="it cannot be written"):
        write_edits(path, edits, "garden.ply", 3)
    assert path.read_bytes() == before and os.listdir(path.parent) == [path.name]
