# SPDX-License-Identifier: GPL-3.0-or-later
"""Where caches are, what happens where there is no room for them, and what is refused before anything is read."""

from __future__ import annotations

import os
import shutil
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from stipple.engine.cache_places import CachePlaces, places_from_environment, user_cache_folder
from stipple.engine.capture_file import CaptureFile
from stipple.engine.errors import StippleError
from stipple.engine.renderer import Renderer
from stipple.engine.scene import Instance, Scene
from stipple.engine.settings import Settings
from tests.capture_files import PLACES, assert_same, cache_of, load, was_cached, write_large
from tests.engine.test_ply_files import random_columns, splat_bytes
from tests.scenes import front_camera


@pytest.fixture
def path(tmp_path: Path) -> Path:
    """A capture of some hundred kB, one splat of which is bad."""
    columns = random_columns(2_000, 15)
    columns["opacity"][7] = np.nan
    path = tmp_path / "garden.ply"
    path.write_bytes(splat_bytes(columns))
    return path


@contextmanager
def largest_file(size: int) -> Iterator[None]:
    """No file of this process may grow beyond `size`: what a full disk does, where there is no small one at hand."""
    import resource

    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


@pytest.mark.skipif(sys.platform == "win32", reason="no file size limit")
def test_a_disk_that_fills_up_is_told_and_costs_the_cache_only(path: Path) -> None:
    with largest_file(8_192):
        capture, cloud, _ = load(path)
    assert any(str(cache_of(path)) in text and "cannot be written" in text for text in capture.warnings)
    assert os.listdir(path.parent) == ["garden.ply"]
    assert_same(cloud, load(path)[1])


def test_a_full_disk_is_told_with_numbers(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    usage = type("Usage", (), {"free": 10})
    monkeypatch.setattr("stipple.engine.capture_upload.shutil.disk_usage", lambda folder: usage)
    capture, _, _ = load(path)
    assert any("there is no room" in text and "GiB are free" in text for text in capture.warnings)
    assert os.listdir(path.parent) == ["garden.ply"]


@contextmanager
def read_only(folder: Path) -> Iterator[None]:
    """Also for root, who may write everywhere: as another user."""
    folder.chmod(0o555)
    root = os.geteuid() == 0
    if root:
        os.seteuid(65534)
    try:
        yield
    finally:
        if root:
            os.seteuid(0)
        folder.chmod(0o755)


@pytest.mark.skipif(not hasattr(os, "geteuid"), reason="no POSIX permissions")
def test_the_cache_of_a_folder_that_cannot_be_written_is_in_the_users(path: Path) -> None:
    load(path, places=CachePlaces(beside=False))  # compiled while everything can be written
    with tempfile.TemporaryDirectory() as everyones:  # pytest's own folders are closed to other users
        captures, folder = Path(everyones, "captures"), Path(everyones, "user", "caches")
        for parent in (captures, folder):
            parent.mkdir(parents=True)
        for place in (Path(everyones), folder.parent, folder):
            place.chmod(0o777)
        capture_path = Path(shutil.copy(path, captures))
        places = CachePlaces(folder=folder, smallest_bytes=0)
        with read_only(captures):
            _, made, texts = load(capture_path, places=places)
        assert "writing the cache of garden" in texts
        (cache,) = folder.iterdir()
        assert cache.name.startswith("garden-") and os.listdir(captures) == ["garden.ply"]
        capture, read, texts = load(capture_path, places=places)
        assert was_cached(texts) and len(capture.warnings) == 1
        assert_same(made, read)


def test_two_captures_of_one_name_have_two_caches_in_one_folder(tmp_path: Path) -> None:
    places = CachePlaces(beside=False, folder=tmp_path / "caches")
    one, two = (tmp_path / name / "point_cloud.ply" for name in ("a", "b"))
    assert places.of(one) != places.of(two)
    assert {place.parent for place in (*places.of(one), *places.of(two))} == {tmp_path / "caches"}
    assert places.to_write(one) == places.of(one)[0] and (tmp_path / "caches").is_dir()


def test_small_files_and_those_without_a_place_have_no_cache(tmp_path: Path) -> None:
    path = write_large(tmp_path / "garden.ply", 500, 0)
    for places in (CachePlaces(), CachePlaces(beside=False, smallest_bytes=0)):
        capture, _, _ = load(path, places=places)
        assert os.listdir(tmp_path) == ["garden.ply"] and capture.warnings == ()


def test_the_environment_says_where(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.delenv("STIPPLE_CACHE", raising=False)
    assert places_from_environment() == CachePlaces(folder=user_cache_folder())
    monkeypatch.setenv("STIPPLE_CACHE", "off")
    assert places_from_environment().of(tmp_path / "garden.ply") == ()
    monkeypatch.setenv("STIPPLE_CACHE", str(tmp_path))
    (place,) = places_from_environment().of(tmp_path / "elsewhere" / "garden.ply")
    assert place.parent == tmp_path


def test_too_little_memory_is_refused_with_numbers_before_anything_is_read(
    path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("stipple.engine.cloud_upload.free_bytes", lambda device: 100_000)
    scene = Scene((Instance(CaptureFile.open(path, PLACES)),))
    with pytest.raises(StippleError, match=r"garden: 0\.00 GiB are needed on cpu and 0\.00 GiB are free"):
        Renderer("cpu").render(scene, front_camera(), Settings())
    assert os.listdir(path.parent) == ["garden.ply"]
