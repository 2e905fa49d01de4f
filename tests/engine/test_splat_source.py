# SPDX-License-Identifier: GPL-3.0-or-later
"""Reading a capture in chunks gives what reading it whole gives, whatever is asked for and however it is cut."""

from __future__ import annotations

import os
from collections.abc import Iterable
from pathlib import Path

import numpy as np
import pytest

from stipple.engine.errors import Cancelled, StippleError
from stipple.engine.formats import open_splats, read_splats
from stipple.engine.formats import splat_source as splat_source_module
from stipple.engine.formats.splat_source import Dropped, SplatSource
from stipple.engine.splats import ARRAY_NAMES, SplatChunk
from tests.engine.test_ply_files import ENCODINGS, REST_COUNTS, Element, ply_bytes, random_columns, splat_bytes

COUNT = 1_000
LISTS = "lists"


def capture(folder: Path, encoding: str = "binary_little_endian", degree: int = 1, bad: Iterable[int] = ()) -> Path:
    """A file of 1,000 splats; those in `bad` each lack something else."""
    columns = random_columns(COUNT, REST_COUNTS[degree])
    faults = [("x", np.nan), ("scale_1", 89.0), ("opacity", -np.inf), ("rot_2", np.inf), ("f_dc_0", np.nan)]
    for place, row in enumerate(bad):
        name, value = faults[place % len(faults)]
        columns[name][row] = value
    path = folder / "tree.ply"
    if encoding == LISTS:
        path.write_bytes(ply_bytes(Element("vertex", columns, lists={"n": ("uchar", "int", [[1]] * COUNT)})))
    else:
        path.write_bytes(splat_bytes(columns, encoding=encoding))
    return path


def joined(chunks: Iterable[SplatChunk], name: str) -> np.ndarray:
    return np.concatenate([getattr(chunk, name) for chunk in chunks])


@pytest.mark.parametrize("encoding", [*ENCODINGS, LISTS])
@pytest.mark.parametrize("chunk_splats", [1, 7, 333, COUNT, 5 * COUNT])
def test_chunks_are_the_whole_cut_up(tmp_path: Path, encoding: str, chunk_splats: int) -> None:
    path = capture(tmp_path, encoding, bad=(0, 6, 7, 500, 999))
    whole, dropped = read_splats(path), Dropped()
    source = open_splats(path)
    assert (source.name, source.splat_count, source.sh_degree) == ("tree", COUNT, 1)
    chunks = list(source.chunks(chunk_splats=chunk_splats, dropped=dropped))
    assert len(chunks) == -(-COUNT // chunk_splats)
    assert sum(chunk.splat_count for chunk in chunks) == whole.cloud.splat_count == COUNT - 5
    for name in ARRAY_NAMES:
        assert np.array_equal(joined(chunks, name), getattr(whole.cloud, name)), name
    assert dropped.count == whole.dropped == 5
    assert sorted(dropped.reasons.values()) == 5 * [1]
    (warning,) = dropped.warnings(path, COUNT)
    assert all(f"{reason} in 1" in whole.warnings[0] and f"{reason} in 1" in warning for reason in dropped.reasons)


@pytest.mark.parametrize("encoding", [*ENCODINGS, LISTS])
def test_what_is_not_asked_for_is_empty_and_still_decides_what_is_dropped(tmp_path: Path, encoding: str) -> None:
    path = capture(tmp_path, encoding, bad=range(0, 1000, 91))
    cloud = read_splats(path).cloud
    for name in ARRAY_NAMES:
        dropped = Dropped()
        chunks = list(open_splats(path).chunks((name,), chunk_splats=100, dropped=dropped))
        assert np.array_equal(joined(chunks, name), getattr(cloud, name))
        assert dropped.count == COUNT - cloud.splat_count == 11
        for other in set(ARRAY_NAMES) - {name}:
            assert joined(chunks, other).shape == (0, *getattr(cloud, other).shape[1:])


def test_a_chunk_of_bad_splats_only_is_empty_and_the_rest_is_read(tmp_path: Path) -> None:
    path = capture(tmp_path, bad=range(100, 200))
    chunks = list(open_splats(path).chunks(chunk_splats=100))
    assert [chunk.splat_count for chunk in chunks] == [100, 0, *8 * [100]]


def test_a_file_of_bad_splats_only_is_an_error(tmp_path: Path) -> None:
    source = open_splats(capture(tmp_path, bad=range(COUNT)))
    with pytest.raises(StippleError, match=r"all of its 1,000 splats are unusable: x is not finite in 200"):
        list(source.chunks(chunk_splats=100))


def test_chunks_keep_their_values_when_later_ones_are_read(tmp_path: Path) -> None:
    reading = open_splats(capture(tmp_path)).chunks(chunk_splats=100)
    first = next(reading)
    before = first.position.copy()
    list(reading)
    assert np.array_equal(first.position, before)


def test_a_chunk_takes_some_32_mebibytes_unless_told_otherwise(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = capture(tmp_path)
    chunk = next(open_splats(path).chunks())
    assert chunk.splat_count == COUNT
    monkeypatch.setattr(splat_source_module, "CHUNK_BYTES", 10_000)
    sizes = [sum(getattr(chunk, name).nbytes for name in ARRAY_NAMES) for chunk in open_splats(path).chunks()]
    assert len(sizes) > 5 and max(sizes) <= 10_000


@pytest.mark.parametrize("encoding", [*ENCODINGS, LISTS])
def test_progress_rises_to_the_end_and_may_cancel(tmp_path: Path, encoding: str) -> None:
    source, fractions = open_splats(capture(tmp_path, encoding)), []
    for _ in source.chunks(chunk_splats=300, progress=lambda fraction, text: fractions.append((fraction, text))):
        pass
    values = [fraction for fraction, _ in fractions]
    assert values == sorted(values) and values[-1] == 1.0 and len(values) >= 4
    assert {text for _, text in fractions} == {"reading tree"}

    def cancel(fraction: float, text: str) -> None:
        raise Cancelled

    descriptors = open_descriptors()
    with pytest.raises(Cancelled):
        list(source.chunks(progress=cancel))
    assert open_descriptors() == descriptors


def open_descriptors() -> int:
    """Files that this process holds open; 0 where the system does not tell."""
    return len(os.listdir("/proc/self/fd")) if Path("/proc/self/fd").exists() else 0


def test_a_reading_that_is_not_finished_closes_the_file(tmp_path: Path) -> None:
    descriptors = open_descriptors()
    reading = open_splats(capture(tmp_path)).chunks(chunk_splats=10)
    next(reading)
    reading.close()  # type: ignore[attr-defined]
    assert open_descriptors() == descriptors


def changed_source(folder: Path) -> tuple[SplatSource, Path]:
    path = capture(folder)
    return open_splats(path), path


def test_a_file_that_was_written_anew_is_not_read_on(tmp_path: Path) -> None:
    source, path = changed_source(tmp_path)
    os.utime(path, ns=(1, 1))
    with pytest.raises(StippleError, match=r"tree\.ply: the file changed after it was opened"):
        next(source.chunks())


def test_a_file_that_is_cut_short_while_it_is_read_is_an_error(tmp_path: Path) -> None:
    source, path = changed_source(tmp_path)
    reading = source.chunks(chunk_splats=100)
    next(reading)
    os.truncate(path, path.stat().st_size // 2)
    with pytest.raises(StippleError, match=r"tree\.ply: the file changed while it was read"):
        list(reading)


def test_too_little_memory_is_refused_with_numbers(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = capture(tmp_path)
    monkeypatch.setattr(splat_source_module, "host_free_bytes", lambda: 50_000)
    with pytest.raises(StippleError) as caught:
        read_splats(path)
    assert "0.00 GiB are needed for 1,000 splats" in str(caught.value) and "linked capture" in str(caught.value)
    assert len(list(open_splats(path).chunks(chunk_splats=100))) == 10  # which takes less
