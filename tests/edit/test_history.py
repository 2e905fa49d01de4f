# SPDX-License-Identifier: GPL-3.0-or-later
"""The history: what it keeps, what it drops, and what it costs."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from stipple.engine.edit.editable_cloud import EditableCloud
from stipple.engine.edit.flags import counts, delete, hide, keep_only, lock, restore, reveal, unlock
from stipple.engine.edit.history import History
from stipple.engine.edit.mask import mask_from_numpy
from stipple.engine.edit.match_values import match_opacity
from stipple.engine.edit.selection import select, select_all
from stipple.engine.edit.state import LOCKED
from stipple.engine.edit.step import STEP_BYTES
from stipple.engine.errors import StippleError
from tests.edit.every_byte import assert_same, every_byte

Clouds = Callable[..., EditableCloud]


@pytest.mark.parametrize("operation", [delete, keep_only, hide, lock])
@pytest.mark.parametrize("count", [1, 31, 32, 33, 1000])
def test_flags_come_back_and_cost_a_bit(make_cloud: Clouds, operation: Callable, count: int) -> None:
    cloud = make_cloud(count)
    history = History(cloud)
    history.do(select(cloud, mask_from_numpy(np.arange(count) % 3 == 0, cloud.device)))
    before = every_byte(cloud)
    if operation is keep_only and count == 1:
        with pytest.raises(StippleError, match="everything is selected, and nothing else is left to delete"):
            keep_only(cloud)
        return
    step = operation(cloud)
    assert_same(cloud, before)
    assert step.nbytes <= count / 8 + 64 + 4
    assert step.changed == (
        (np.arange(count) % 3 == 0).sum() if operation is not keep_only else (np.arange(count) % 3 > 0).sum()
    )
    history.do(step)
    after = every_byte(cloud)
    if step.changed:
        history.undo()
        assert_same(cloud, before)
        history.redo()
        assert_same(cloud, after)


def test_counterparts(make_cloud: Clouds) -> None:
    cloud = make_cloud(200)
    history = History(cloud)
    for do, back, key in ((delete, restore, "deleted"), (hide, reveal, "hidden"), (lock, unlock, "locked")):
        with pytest.raises(StippleError, match=f"no splats are {key}"):
            back(cloud)
        history.do(select(cloud, match_opacity(cloud, 0.5)))
        selected = counts(cloud)["selected"]
        history.do(do(cloud))
        assert counts(cloud)[key] == selected and counts(cloud)["selected"] == 0
        history.do(select_all(cloud))
        assert counts(cloud)["selected"] == 200 - selected
        history.do(back(cloud))
        assert counts(cloud)[key] == 0
        assert counts(cloud)["selected"] == 200  # what was selected when it went is selected again
        history.do(select_all(cloud, "none"))
    history.go_to(0)
    assert counts(cloud) == {"total": 200, **dict.fromkeys(("selected", "hidden", "deleted", "separated", "locked"), 0)}


def test_reveal_selects_what_it_shows_and_is_unlocked(make_cloud: Clouds) -> None:
    cloud = make_cloud(200)
    history, rows = History(cloud), np.arange(200)
    history.do(select(cloud, mask_from_numpy(rows < 20, cloud.device)))
    history.do(hide(cloud))
    history.do(select(cloud, mask_from_numpy((rows >= 20) & (rows < 60), cloud.device)))
    history.do(select(cloud, mask_from_numpy(rows < 60, cloud.device), "add"))
    history.do(hide(cloud, unselected=True))  # all but 20 … 59, never selected
    cloud.state.assign(np.where(rows >= 190, cloud.state.numpy() | LOCKED, cloud.state.numpy()))
    before = every_byte(cloud)
    for wanted, chosen in ((True, rows < 190), (False, (rows >= 20) & (rows < 60))):
        history.do(reveal(cloud, wanted))
        np.testing.assert_array_equal(cloud.selection().numpy(), chosen)
        assert counts(cloud)["hidden"] == 0
        history.undo()
        assert_same(cloud, before)


def test_where_everything_is_selected_there_is_nothing_else(make_cloud: Clouds) -> None:
    cloud = make_cloud(50)
    History(cloud).do(select_all(cloud))
    before = every_byte(cloud)
    calls = {"delete": keep_only, "hide": lambda c: hide(c, True), "lock": lambda c: lock(c, True)}
    for verb, call in calls.items():
        with pytest.raises(StippleError, match=f"everything is selected, and nothing else is left to {verb}"):
            call(cloud)
    assert_same(cloud, before)


def test_deleted_splats_are_left_out(make_cloud: Clouds) -> None:
    cloud = make_cloud(200, sh_degree=2)
    history = History(cloud)
    history.do(select(cloud, match_opacity(cloud, 0.5)))
    whole, kept = cloud.to_cloud(), cloud.to_cloud().opacity < 0.5
    history.do(delete(cloud))
    left = cloud.to_cloud()
    for name in ("position", "scale", "rotation", "opacity", "sh_dc", "sh_rest"):
        assert np.array_equal(getattr(left, name), getattr(whole, name)[kept])
    history.do(select_all(cloud))
    history.do(delete(cloud))
    with pytest.raises(StippleError, match="no splats are left"):
        cloud.to_cloud()


def test_a_new_step_drops_what_was_undone(make_cloud: Clouds) -> None:
    cloud = make_cloud(64)
    history = History(cloud)
    history.do(select(cloud, match_opacity(cloud, 0.5)))
    history.do(hide(cloud))
    history.undo()
    history.do(delete(cloud))
    assert [step.name for step in history.steps] == ["Select", "Delete"]
    with pytest.raises(StippleError, match="nothing to redo"):
        history.redo()


def test_steps_that_change_nothing_are_not_recorded(make_cloud: Clouds) -> None:
    cloud = make_cloud(64)
    history = History(cloud)
    assert not history.do(select_all(cloud, "none"))
    assert history.steps == ()
    with pytest.raises(StippleError, match="nothing to undo"):
        history.undo()


def test_memory_is_bounded_and_positions_stay(make_cloud: Clouds) -> None:
    cloud = make_cloud(3200)
    history = History(cloud)
    history.do(select_all(cloud, "all"))
    one = history.nbytes
    assert one == 3200 / 8 + STEP_BYTES
    history.limit_bytes = 10 * one
    for _ in range(30):
        history.do(select_all(cloud, "invert"))
        assert history.nbytes <= 10 * one
    assert (history.first_position, history.position, history.last_position) == (21, 31, 31)
    at_25 = None
    for position in range(31, 20, -1):
        history.go_to(position)
        if position == 25:
            at_25 = every_byte(cloud)
    history.go_to(31)
    history.go_to(25)
    assert_same(cloud, at_25)
    for position in (20, 32):
        with pytest.raises(StippleError, match="no longer in the editing history"):
            history.go_to(position)
    assert_same(cloud, at_25)
    history.limit_bytes = 0
    assert history.first_position == 25
    history.clear()
    assert history.nbytes == 0 and history.position == 25


def test_no_memory_changes_nothing(make_cloud: Clouds, monkeypatch: pytest.MonkeyPatch) -> None:
    cloud = make_cloud(3200)
    history = History(cloud)
    history.do(select(cloud, match_opacity(cloud, 0.5)))
    before = every_byte(cloud)
    monkeypatch.setattr("stipple.engine.buffers.free_bytes", lambda device: 100)
    for operation in (delete, hide, lambda c: select_all(c, "invert")):
        with pytest.raises(StippleError, match=r"are needed for .* and .* are free"):
            operation(cloud)
    assert_same(cloud, before)
    assert len(history.steps) == 1
