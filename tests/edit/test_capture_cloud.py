# SPDX-License-Identifier: GPL-3.0-or-later
"""Attributes of a linked capture that are unpacked when they are asked for."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from stipple.engine.errors import StippleError
from tests.edit.edited_captures import capture_of, edited, unpacked


@pytest.mark.parametrize("where", ["paint_layer", "editable_cloud"])
def test_memory_that_runs_out_while_colour_is_unpacked_leaves_no_unpainted_one(
    tmp_path: Path, device: str, where: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    capture = capture_of(tmp_path)
    live = unpacked(capture, device)
    again = unpacked(capture, device, edited(live))

    def full(*_: object) -> None:
        raise StippleError("no memory")

    with monkeypatch.context() as patch:
        patch.setattr(f"stipple.engine.edit.{where}.allocate", full)
        with pytest.raises(StippleError, match="no memory"):
            again.array("sh_dc")
    for name in ("sh_dc", "base_dc", "paint"):
        assert np.array_equal(again.array(name).numpy(), live.array(name).numpy())
