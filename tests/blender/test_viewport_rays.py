# SPDX-License-Identifier: GPL-3.0-or-later
"""Viewport sessions of *rays*, driven without a window: sorted by one side, drawn by the other."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from stipple.addon.graphics import has_graphics

from .fresh_process import fresh_python

pytestmark = [pytest.mark.blender, pytest.mark.skipif(not has_graphics(), reason="no EGL here")]

# In a process of its own, because moderngl may not share one with Blender's gpu module.
PROGRAM = """
import json, sys, time
import numpy as np
from stipple.addon import viewport_rays
from stipple.engine.renderer import Renderer
from tests.blender.test_viewport import aim, never, random_cloud
from tests.light import light_of

viewport_rays.LONGEST_SORT = 0.2
sorter, drawer = Renderer("cpu"), Renderer("cpu")
tags, result = [], {}
session = viewport_rays.RaysViewportSession(lambda: tags.append(1))

def rest(method="rays"):
    renders = 0
    while (due := session.due()) is not None:
        time.sleep(due)
        session.step(sorter, never)
        session.render(drawer)
        session.take()
        renders += 1
    return renders

def error(target):
    picture = Renderer.render(drawer, target.scene, target.view.camera(), target.settings)
    return float(np.abs(session.picture.rgba - light_of(picture.rgba)).max())

cloud = random_cloud()
from dataclasses import replace
from stipple.engine.scene import Scene
first = aim(cloud, 0.0, "rays")
moved, again = (replace(first, view=aim(cloud, shift, "rays").view) for shift in (0.1, 0.2))
session.aim_at(first)
session.render(drawer)
result["picture before any order"] = session.picture is not None
rest()
result["at rest"], result["message"] = error(first), session.message
drawer.raster().given_order = None
session.aim_at(moved)
session.render(drawer)  # nobody has sorted for it: drawn with the order of the view before
late = session.picture
result["one view behind"] = session._drawn_with == first and session._small == moved
session.aim_at(again)
session.render(drawer)  # the order is two views old now
result["two views behind"] = session.picture is not late
rest()
drawer.raster().given_order = None
result["after sorting"] = error(again)
target = replace(again, settings=replace(again.settings, ray_order="stochastic", samples=6))
session.aim_at(target)
result["redraws of six samples"] = rest()
drawer.raster().given_order = None
result["stochastic"], result["samples"] = error(target), session.picture.samples
session.close()
result["closed"] = session.due() is None
json.dump(result, open(sys.argv[1], "w"))
"""


@pytest.fixture(scope="module")
def told(tmp_path_factory: pytest.TempPathFactory, root: Path) -> dict[str, Any]:
    pytest.importorskip("moderngl")
    path = tmp_path_factory.mktemp("rays") / "told.json"
    fresh_python(root, PROGRAM, path)
    return json.loads(path.read_text())


def test_a_resting_viewport_ends_at_the_renderers_own_picture(told: dict[str, Any]) -> None:
    assert not told["picture before any order"] and told["message"] == ""
    assert told["at rest"] == 0.0 and told["after sorting"] == 0.0


def test_an_order_is_used_for_one_view_more_and_no_longer(told: dict[str, Any]) -> None:
    assert told["one view behind"]
    assert not told["two views behind"]


def test_stochastic_rays_accumulate_a_sample_per_redraw(told: dict[str, Any]) -> None:
    assert told["samples"] == 6 and told["stochastic"] == 0.0
    assert 6 <= told["redraws of six samples"] <= 9  # and what the small picture takes
    assert told["closed"]
