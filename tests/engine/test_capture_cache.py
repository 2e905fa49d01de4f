# SPDX-License-Identifier: GPL-3.0-or-later
"""The cache of a capture: the second opening reads nothing else, and whatever is wrong with it, it is made anew."""

from __future__ import annotations

import json
import os
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from stipple.engine import capture_cache
from stipple.engine.capture_file import CaptureFile
from stipple.engine.device import choose_device
from stipple.engine.errors import Cancelled
from stipple.engine.formats import read_splats
from stipple.engine.quantise import quantise
from tests.capture_files import PLACES, assert_same, cache_of, load, was_cached
from tests.engine.test_ply_files import random_columns, splat_bytes


@pytest.fixture(params=[0, 15], ids=["degree 0", "degree 3"])
def path(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    """A capture of some hundred kB, one splat of which is bad."""
    columns = random_columns(2_000, request.param)
    columns["opacity"][7] = np.nan
    path = tmp_path / "garden.ply"
    path.write_bytes(splat_bytes(columns))
    return path


def test_the_second_opening_reads_the_cache_only_and_gives_the_same(path: Path, device: str) -> None:
    first, made, texts = load(path, device)
    assert {"reading garden (1/2)", "reading garden (2/2)", "writing the cache of garden"} == texts
    second, read, texts = load(path, device)
    assert was_cached(texts)
    assert_same(made, read)
    assert first.warnings == second.warnings
    assert "1 of 2,000 splats were left out: opacity is not finite in 1" in second.warnings[0]
    assert second.nbytes < first.packed_bytes * 1.5 < 1.2 * cache_of(path).stat().st_size + 1e5


def test_what_is_made_of_a_file_is_what_is_made_of_its_cloud(path: Path, device: str) -> None:
    _, made, _ = load(path, device)
    cloud = read_splats(path).cloud
    whole = quantise(lambda _: [cloud], cloud.splat_count, cloud.sh_degree, "garden", choose_device(device))
    assert_same(made, whole)


def test_two_who_ask_share_what_is_on_the_device(path: Path) -> None:
    capture, cloud, _ = load(path)
    calls: list[str] = []
    again = capture.upload(choose_device("cpu"), lambda fraction, text: calls.append(text))
    assert again is cloud and not calls
    del again, cloud
    capture.upload(choose_device("cpu"), lambda fraction, text: calls.append(text))
    assert calls


def flip(place: Callable[[int], int]) -> Callable[[Path], None]:
    def damage(cache: Path) -> None:
        data = bytearray(cache.read_bytes())
        data[place(len(data))] ^= 0x10
        cache.write_bytes(data)

    return damage


def cut(share: float) -> Callable[[Path], None]:
    return lambda cache: os.truncate(cache, int(cache.stat().st_size * share))


def directory_changed(change: Callable[[dict[str, Any]], object]) -> Callable[[Path], None]:
    """A directory that says something else and has the right checksum."""

    def damage(cache: Path) -> None:
        data = cache.read_bytes()
        magic, version, meaning, begin, length, _ = capture_cache.PREAMBLE.unpack(data[:64])
        directory = json.loads(data[begin : begin + length])
        change(directory)
        text = json.dumps(directory).encode()
        start = capture_cache.PREAMBLE.pack(magic, version, meaning, begin, len(text), zlib.crc32(text))
        cache.write_bytes(start + data[64:begin] + text)

    return damage


def with_field(index: int, value: Any) -> Callable[[Path], None]:
    """A preamble with another value in one of its fields."""

    def damage(cache: Path) -> None:
        data = cache.read_bytes()
        fields = list(capture_cache.PREAMBLE.unpack(data[:64]))
        fields[index] = value
        cache.write_bytes(capture_cache.PREAMBLE.pack(*fields) + data[64:])

    return damage


def geometry(directory: dict[str, Any]) -> dict[str, Any]:
    return directory["arrays"]["packed_geometry"]


DAMAGES: dict[str, Callable[[Path], None]] = {
    "empty": cut(0.0),
    "cut in the preamble": lambda cache: os.truncate(cache, 20),
    "cut in an array": cut(0.3),
    "cut in the directory": lambda cache: os.truncate(cache, cache.stat().st_size - 1),
    "a bit of the magic": flip(lambda size: 2),
    "a bit of an array": flip(lambda size: 5_000),
    "a bit in the middle": flip(lambda size: size // 2 // 4096 * 4096 + 16),
    "a bit of the directory": flip(lambda size: size - 10),
    "zeros": lambda cache: cache.write_bytes(bytes(cache.stat().st_size)),
    "no directory": with_field(3, 1 << 40),
    "a huge directory": with_field(4, 1 << 60),
    "no facts": directory_changed(lambda d: d["facts"].clear()),
    "no arrays": directory_changed(lambda d: d["arrays"].clear()),
    "other facts": directory_changed(lambda d: d["facts"].update(place_count=256)),
    "another size": directory_changed(lambda d: geometry(d).update(nbytes=16)),
    "another shape": directory_changed(lambda d: geometry(d).update(shape=[1 << 40])),
    "beyond the end": directory_changed(lambda d: geometry(d).update(offset=1 << 40)),
    "before the start": directory_changed(lambda d: geometry(d).update(offset=-1)),
    "not a number": directory_changed(lambda d: geometry(d).update(offset="x")),
    "no fingerprint": directory_changed(lambda d: d.pop("fingerprint")),
    "a list": directory_changed(lambda d: d.update(arrays=[1])),
    "a folder": lambda cache: (cache.unlink(), cache.mkdir()),
}
STALE = {
    "another version": with_field(1, 99),
    "other meaning": with_field(2, 99),
    "another capture": directory_changed(lambda d: d["fingerprint"].update(samples="00")),
}


@pytest.mark.parametrize("damage", DAMAGES)
def test_a_damaged_cache_is_made_anew(path: Path, damage: str) -> None:
    _, made, _ = load(path)
    DAMAGES[damage](cache_of(path))
    capture, again, texts = load(path)
    assert not was_cached(texts)
    assert_same(made, again)
    if damage != "a folder":
        assert any(str(cache_of(path)) in text and "is read again" in text for text in capture.warnings), damage
        assert was_cached(load(path)[2])


@pytest.mark.parametrize("change", STALE)
def test_a_stale_cache_is_made_anew_without_a_word(path: Path, change: str) -> None:
    _, made, _ = load(path)
    STALE[change](cache_of(path))
    capture, again, texts = load(path)
    assert not was_cached(texts) and len(capture.warnings) == 1  # about the bad splat
    assert_same(made, again)
    assert was_cached(load(path)[2])


def test_every_bit_of_a_cache_is_checked(path: Path) -> None:
    """But for the zeros between arrays, which hold nothing."""
    _, made, _ = load(path)
    good = cache_of(path).read_bytes()
    rng = np.random.default_rng(4)
    for place in rng.integers(0, len(good), 60).tolist():
        data = bytearray(good)
        data[place] ^= 1 << int(rng.integers(0, 8))
        cache_of(path).write_bytes(data)
        assert_same(made, load(path)[1])


@pytest.mark.parametrize("what", ["size", "date", "content"])
def test_a_capture_that_changed_is_read_again(path: Path, what: str) -> None:
    load(path)
    status, data = path.stat(), bytearray(path.read_bytes())
    if what == "size":
        path.write_bytes(data + b" ")
    elif what == "content":
        data[-3] ^= 1  # of the last rotation
        path.write_bytes(data)
    os.utime(path, ns=(1, status.st_mtime_ns + (what == "date")))
    _, cloud, texts = load(path)
    assert not was_cached(texts)
    again = read_splats(path).cloud
    assert_same(cloud, quantise(lambda _: [again], again.splat_count, again.sh_degree, "", choose_device("cpu")))


def test_a_cancelled_loading_leaves_nothing(path: Path) -> None:
    for word in ("(1/2)", "(2/2)", "writing"):

        def cancel(fraction: float, text: str, word: str = word) -> None:
            if word in text:
                raise Cancelled

        with pytest.raises(Cancelled):
            CaptureFile.open(path, PLACES).upload(choose_device("cpu"), cancel)
        assert os.listdir(path.parent) == ["garden.ply"]
    load(path)

    def cancel_all(fraction: float, text: str) -> None:
        raise Cancelled

    with pytest.raises(Cancelled):
        CaptureFile.open(path, PLACES).upload(choose_device("cpu"), cancel_all)
    assert was_cached(load(path)[2])
