# SPDX-License-Identifier: GPL-3.0-or-later
"""A capture that stays in its file: what is known of it without reading, and what one reading finds."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

from stipple.engine import capture_file as capture_file_module
from stipple.engine.capture_file import CaptureFile
from stipple.engine.capture_fingerprint import fingerprint_of
from stipple.engine.errors import Cancelled, StippleError
from stipple.engine.formats import read_splats
from stipple.engine.formats.ply_read import PlySource
from stipple.engine.splats import ARRAY_NAMES
from tests.capture_files import write_large
from tests.engine.test_ply_files import random_columns, splat_bytes


def test_opening_reads_the_header_only(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = write_large(tmp_path / "garden.ply", 5_000, 8)
    monkeypatch.setattr(PlySource, "chunks", lambda *_: pytest.fail("it was read"))
    monkeypatch.chdir(tmp_path)
    capture = CaptureFile.open("garden.ply")
    assert (capture.path, capture.name, capture.splat_count, capture.sh_degree) == (path, "garden", 5_000, 2)
    assert capture.warnings == ()


@pytest.mark.parametrize(
    ("content", "text"), [(None, "there is no such file"), (b"", "is empty"), (b"nothing", "not a PLY")]
)
def test_what_cannot_be_opened_is_one_sentence(tmp_path: Path, content: bytes | None, text: str) -> None:
    path = tmp_path / "garden.ply"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(StippleError, match=text):
        CaptureFile.open(path)


def test_a_survey_is_the_cloud_sampled_and_bounded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    columns = random_columns(1_000, 3)
    columns["y"][[0, 17, 999]] = np.nan
    path = tmp_path / "garden.ply"
    path.write_bytes(splat_bytes(columns))
    cloud = read_splats(path).cloud
    monkeypatch.setattr(capture_file_module, "SAMPLE_SPLATS", 90)
    monkeypatch.setattr("stipple.engine.formats.splat_source.CHUNK_BYTES", 5_000)
    capture = CaptureFile.open(path)
    fractions: list[float] = []
    survey = capture.survey(lambda fraction, text: fractions.append(fraction))
    assert fractions[-1] == 1.0
    assert (survey.splat_count, survey.dropped.count) == (997, 3)
    assert np.array_equal(survey.bounds, cloud.bounds) and capture.bounds is survey.bounds
    assert survey.sample.splat_count == 84  # every twelfth of 997
    for name in ARRAY_NAMES:
        assert np.array_equal(getattr(survey.sample, name), getattr(cloud, name)[::12]), name
    assert capture.survey() is survey


def test_a_survey_can_be_cancelled_and_begun_again(tmp_path: Path) -> None:
    capture = CaptureFile.open(write_large(tmp_path / "garden.ply", 2_000, 0))

    def cancel(fraction: float, text: str) -> None:
        raise Cancelled

    with pytest.raises(Cancelled):
        capture.survey(cancel)
    assert capture.survey().splat_count == 2_000


def test_a_fingerprint_is_of_size_date_and_content(tmp_path: Path) -> None:
    path = write_large(tmp_path / "garden.ply", 3_000, 0)
    before = fingerprint_of(path)
    assert fingerprint_of(path) == before
    date, content = before.modified_ns, path.read_bytes()
    for place in (10, len(content) // 2, len(content) - 1):
        path.write_bytes(content[:place] + bytes([content[place] ^ 1]) + content[place + 1 :])
        os.utime(path, ns=(date, date))
        after = fingerprint_of(path)
        assert (after.file_bytes, after.modified_ns) == (before.file_bytes, before.modified_ns)
        assert after.samples != before.samples, place
    path.write_bytes(content)
    assert fingerprint_of(path).samples == before.samples
    os.utime(path, ns=(date + 1, date + 1))
    assert fingerprint_of(path) != before


def test_a_large_file_is_sampled_from_end_to_end(tmp_path: Path) -> None:
    path = tmp_path / "garden.bin"
    with path.open("wb") as file:
        file.truncate(100 << 20)
    before = fingerprint_of(path)
    for place in (0, (100 << 20) - 1):
        with path.open("r+b") as file:
            file.seek(place)
            file.write(b"x")
        after = fingerprint_of(path)
        assert after.samples != before.samples
        before = after


def test_a_file_that_changed_is_not_read_as_what_it_was(tmp_path: Path) -> None:
    path = write_large(tmp_path / "garden.ply", 2_000, 0)
    capture = CaptureFile.open(path)
    assert not capture.has_changed()
    write_large(path, 1_000, 0)
    assert capture.has_changed()
    with pytest.raises(StippleError, match=r"garden\.ply: the file has changed since it was opened; load it again"):
        capture.survey()
    path.unlink()
    assert capture.has_changed()
    with pytest.raises(StippleError, match="there is no such file"):
        capture.survey()
