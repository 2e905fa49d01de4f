# SPDX-License-Identifier: GPL-3.0-or-later
"""The clouds of sequences: a limit on their memory, and many threads that ask for them."""

from __future__ import annotations

import threading
from pathlib import Path

import numpy as np
import pytest

from stipple.addon.sequence_cache import SequenceClouds
from stipple.engine.formats import read_splats

from .numbered import write_numbered

pytestmark = pytest.mark.blender


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return write_numbered(tmp_path)


def test_memory_is_bounded(folder: Path) -> None:
    clouds = SequenceClouds()
    paths = sorted(folder.glob("walk.*.ply"))
    sizes = [read_splats(path).cloud.nbytes for path in paths]
    for limit, hoard, kept in ((1 << 30, True, 4), (1 << 30, False, 1), (0, True, 1), (sum(sizes[-2:]), True, 2)):
        for path in paths:
            with clouds.reading(limit, hoard=hoard):
                clouds.cloud_of(path)
        assert len(clouds) == kept, limit
        assert clouds.held_bytes == sum(sizes[-kept:])
    with clouds.reading(sizes[0] + 1):
        clouds.cloud_of(paths[0])
        clouds.expect(paths[1])  # for which there is no room
    assert len(clouds) == 1
    clouds.free()
    assert len(clouds) == 0


def test_view_layers_keep_what_each_of_them_shows(folder: Path) -> None:
    clouds = SequenceClouds()
    one, two = sorted(folder.glob("walk.*.ply"))[:2]
    for path in (one, two):
        with clouds.reading(1 << 30, keep=2, hoard=False):
            clouds.cloud_of(path)
    assert len(clouds) == 2
    clouds.free()


def test_many_threads_may_ask_at_once(folder: Path) -> None:
    clouds = SequenceClouds()
    paths, seen, failed = sorted(folder.glob("walk.*.ply")), set(), []

    def ask(seed: int) -> None:
        rng = np.random.default_rng(seed)
        try:
            for index in rng.integers(0, len(paths), 60):
                with clouds.reading(1 << 30):
                    clouds.expect(paths[rng.integers(0, len(paths))])
                    loaded = clouds.cloud_of(paths[index], rng.choice([None, 0.0, 5.0]))
                    if loaded is not None:
                        seen.add((int(index), loaded.cloud.splat_count))
        except BaseException as error:
            failed.append(error)

    threads = [threading.Thread(target=ask, args=(seed,)) for seed in range(6)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(60)
    assert not failed and not any(thread.is_alive() for thread in threads)
    assert seen == {(0, 30), (1, 50), (2, 40), (3, 20)}
    clouds.free()
