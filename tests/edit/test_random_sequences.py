# SPDX-License-Identifier: GPL-3.0-or-later
"""A thousand random operations with undo and redo between them end as the same operations done once, in order."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from stipple.engine.edit import flags
from stipple.engine.edit.affine import composed, mirroring, rotation, scaling, translation
from stipple.engine.edit.brush import FALLOFFS, MODES, Brush
from stipple.engine.edit.clean_up import find_faint, find_floaters, find_outside, find_oversized
from stipple.engine.edit.duplicate import CloneStroke, append_cloud, duplicate, separate
from stipple.engine.edit.editable_cloud import EditableCloud
from stipple.engine.edit.history import History
from stipple.engine.edit.match_screen import match_circle, match_depth, match_polygon, match_rectangle
from stipple.engine.edit.match_space import match_box, match_half_space, match_sphere
from stipple.engine.edit.match_values import match_colour, match_opacity, match_size
from stipple.engine.edit.neighbours import grow, match_connected, match_sparse, shrink
from stipple.engine.edit.paint_stroke import PaintStroke
from stipple.engine.edit.selection import ACTIONS, SelectionStroke, select, select_all
from stipple.engine.edit.selection import MODES as SELECT_MODES
from stipple.engine.edit.transform import TransformDrag, transform
from stipple.engine.errors import StippleError
from tests.edit.every_byte import every_byte
from tests.scenes import front_camera, random_cloud

Clouds = Callable[..., EditableCloud]

FIRST, MOST, FEW = 400, 700, 20  # splats


def some_place(rng: np.random.Generator) -> np.ndarray:
    return rng.uniform([-1.5, -1.2, 2], [1.5, 1.2, 6])


def some_map(rng: np.random.Generator) -> np.ndarray:
    pivot = some_place(rng)
    return [
        translation(rng.normal(0, 0.2, 3)),
        rotation(rng.normal(size=3), rng.normal(), pivot),
        scaling(np.exp(rng.normal(0, 0.1)), pivot),
        scaling(np.exp(rng.normal(0, 0.1, 3)), pivot),
        mirroring(rng.normal(size=3), pivot),
        composed(rotation(rng.normal(size=3), 0.2, pivot), scaling(np.exp(rng.normal(0, 0.1, 3)), pivot)),
    ][rng.integers(6)]


def do_select(history: History, rng: np.random.Generator) -> None:
    cloud, camera = history.cloud, front_camera()
    matches = [
        lambda: match_sphere(cloud, some_place(rng), rng.uniform(0.5, 2)),
        lambda: match_circle(cloud, camera, rng.uniform([0, 0], [64, 48]), rng.uniform(3, 20), bool(rng.integers(2))),
        lambda: match_rectangle(cloud, camera, rng.uniform(0, 30, 2), rng.uniform(30, 64, 2)),
        lambda: match_polygon(cloud, camera, rng.uniform([0, 0], [64, 48], (5, 2))),
        lambda: match_depth(cloud, camera, rng.uniform(0, 4), rng.uniform(4, 8)),
        lambda: match_box(cloud, scaling(rng.uniform(0.3, 1.5, 3), some_place(rng))),
        lambda: match_half_space(cloud, some_place(rng), rng.normal(size=3)),
        lambda: match_colour(cloud, rng.uniform(0, 1, 3), 0.2),
        lambda: match_opacity(cloud, rng.uniform(0, 0.8)),
        lambda: match_size(cloud, rng.uniform(0, 0.4)),
        lambda: match_sparse(cloud, rng.uniform(0.1, 0.6)),
        lambda: match_connected(cloud, match_opacity(cloud, 0.95), rng.uniform(0.05, 0.3)),
        lambda: find_floaters(cloud, rng.uniform(1, 4)),
        lambda: find_oversized(cloud, rng.uniform(0.05, 0.4)),
        lambda: find_faint(cloud, rng.uniform(0, 0.5)),
        lambda: find_outside(cloud, scaling(rng.uniform(0.3, 1.5, 3), some_place(rng))),
    ]
    match = matches[rng.integers(len(matches))]()
    history.do(select(cloud, match, rng.choice(SELECT_MODES)))


def do_stroke(history: History, rng: np.random.Generator) -> None:
    """A stroke that paints, clones, selects or drags; every fourth is cancelled."""
    cloud = history.cloud
    kind = rng.integers(4)
    if kind == 0:
        brush = Brush(
            str(rng.choice(MODES)),
            tuple(rng.uniform(0, 1, 3)),
            rng.uniform(),
            rng.uniform(0.1, 1),
            str(rng.choice(FALLOFFS)),
            bool(rng.integers(2)),
        )
        stroke = PaintStroke(cloud, brush, within=cloud.selection() if rng.integers(4) == 0 else None)
        for _ in range(3):
            stroke.dab(some_place(rng), rng.uniform(0.5, 2), bool(rng.integers(2)))
    elif kind == 1 and cloud.splat_count < MOST:
        stroke = CloneStroke(cloud, translation(rng.normal(0, 0.5, 3)))
        for _ in range(3):
            stroke.dab(some_place(rng), 0.3)
    elif kind == 2:
        stroke = SelectionStroke(cloud, str(rng.choice(["set", "add", "subtract"])))
        for _ in range(3):
            stroke.dab(match_sphere(cloud, some_place(rng), 0.8))
    else:
        stroke = TransformDrag(cloud)
        for _ in range(2):
            stroke.update(some_map(rng))
    if rng.integers(4) == 0:
        stroke.cancel()
        return
    step = stroke.finish()
    if step is not None:
        history.record(step)


def do_flags(history: History, rng: np.random.Generator) -> None:
    operations = [flags.delete, flags.hide, flags.lock, flags.restore, flags.reveal, flags.unlock, flags.restore]
    if rng.integers(8) == 0:
        history.do(flags.keep_only(history.cloud))
    else:
        history.do(operations[rng.integers(7)](history.cloud))


def do_counts(history: History, rng: np.random.Generator) -> None:
    cloud = history.cloud
    if rng.integers(3) == 0:
        if cloud.selection().count() <= FEW:  # they do not come back: of many, nothing would soon be left to work on
            history.do(separate(cloud)[1])
    elif cloud.splat_count < MOST:
        if rng.integers(2):
            history.do(duplicate(cloud, some_map(rng)))
        else:
            history.do(append_cloud(cloud, random_cloud(20, int(rng.integers(1000)), sh_degree=int(rng.integers(4)))))


def operate(history: History, seed: int) -> None:
    """One random operation that depends on its seed and the cloud alone; bad calls are part of the game."""
    rng = np.random.default_rng(seed)
    kind = rng.integers(12)
    try:
        if kind < 4:
            do_select(history, rng)
        elif kind == 4:
            history.do(select_all(history.cloud, str(rng.choice(list(ACTIONS)))))
        elif kind == 5:
            history.do((grow, shrink)[rng.integers(2)](history.cloud, rng.uniform(0.05, 0.3)))
        elif kind < 8:
            do_flags(history, rng)
        elif kind == 8:
            history.do(transform(history.cloud, some_map(rng), keep_values=bool(rng.integers(2))))
        elif kind < 11:
            do_stroke(history, rng)
        else:
            do_counts(history, rng)
    except StippleError:
        pass


def check_sequence(make_cloud: Clouds, seed: int, operations: int, least_names: int) -> None:
    rng = np.random.default_rng(seed)
    history = History(make_cloud(FIRST, seed, int(rng.integers(3))))
    done: list[tuple[int, int, int]] = []  # seed and positions before and after, of what is done and not undone
    count, names = 0, set[str]()
    while count < operations:
        if rng.random() < 0.3:  # a run of undos, and some redos
            target = int(rng.integers(max(history.first_position, history.position - 8), history.position + 1))
            before = history.position
            history.go_to(target)
            if rng.integers(2):
                history.go_to(int(rng.integers(target, before + 1)))
        else:
            done = [entry for entry in done if entry[2] <= history.position]
            before, operation = history.position, int(rng.integers(1 << 31))
            operate(history, operation)
            if history.position > before:
                names.add(history.undo_step.name)
                done.append((operation, before, history.position))
            count += 1
    done = [entry for entry in done if entry[2] <= history.position]
    replay = History(make_cloud(FIRST, seed, history_degree(seed)))
    for operation, _, _ in done:
        operate(replay, operation)
    assert replay.position == history.position == len(done)
    assert every_byte(replay.cloud) == every_byte(history.cloud)
    end = every_byte(history.cloud)
    assert len(names) >= least_names, names
    history.go_to(0)
    assert every_byte(history.cloud) == every_byte(make_cloud(FIRST, seed, history_degree(seed)))
    history.go_to(history.last_position)
    history.go_to(replay.position)
    assert every_byte(history.cloud) == end


def history_degree(seed: int) -> int:
    return int(np.random.default_rng(seed).integers(3))


def test_two_hundred_operations(make_cloud: Clouds) -> None:
    check_sequence(make_cloud, 1, 200, 12)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(2, 6))
def test_a_thousand_operations(make_cloud: Clouds, seed: int) -> None:
    check_sequence(make_cloud, seed, 1000, 16)
