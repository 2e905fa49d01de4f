# SPDX-License-Identifier: GPL-3.0-or-later
"""Linked captures in a viewport: read once though the view moves, with words meanwhile; the proxy of missing files."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest

from stipple.addon import residency
from stipple.addon import viewport as viewport_module
from stipple.addon.residency import CloudCache, EvaluatedClouds
from stipple.addon.sequence import SequencePlayer
from stipple.addon.sync import viewport_instances
from stipple.addon.view_camera import ViewportView
from stipple.addon.viewport import Aim, ViewportSession
from stipple.engine.capture_file import CaptureFile
from stipple.engine.renderer import Renderer
from stipple.engine.scene import Instance, Scene
from stipple.engine.settings import Settings
from stipple.engine.splats import SplatCloud

from .captures import random_cloud, write_ply
from .linked import broken, link
from .test_viewport import ALONG_Y, WINDOW, never, run

pytestmark = pytest.mark.blender


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return write_ply(tmp_path / "garden.ply", random_cloud(300, degree=2))


def aim_at(path: Path) -> Aim:
    settings = Settings(method="sorted", device="cpu")
    scene = Scene((Instance(CaptureFile.open(path)),), (0.1, 0.2, 0.3))
    return Aim(scene, ViewportView(WINDOW, ALONG_Y, 90, 60), settings, "Rec.709")


def test_a_capture_is_read_to_its_end_though_the_view_moves_on(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    aim, session, renderer = aim_at(path), ViewportSession(lambda: None), Renderer("cpu")
    moved = replace(aim, view=replace(aim.view, width=80))
    upload, uploads = CaptureFile.upload, []

    def slow_upload(capture: CaptureFile, device: Any, progress: Any) -> Any:
        def report(fraction: float, text: str) -> None:
            session.aim_at(moved)
            progress(fraction, text)

        uploads.append(capture)
        return upload(capture, device, report)

    monkeypatch.setattr(CaptureFile, "upload", slow_upload)
    session.aim_at(aim)
    session.step(renderer, never)
    assert session.picture is not None and len(uploads) == 1
    assert run(session, renderer)[-1] == (1, 1)
    assert len(uploads) == 1
    renderer.free()


def test_a_long_reading_says_how_far_it_is(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(viewport_module, "LONG", -1.0)
    monkeypatch.setattr(viewport_module, "SAY_INTERVAL", -1.0)
    said: list[str] = []
    session, renderer = ViewportSession(lambda: said.append(session.status())), Renderer("cpu")
    session.aim_at(aim_at(path))
    session.step(renderer, never)
    assert "Reading garden (1/2) 50%" in said and "Reading garden (2/2) 100%" in said
    assert session.status().startswith("Sample 1/1")
    renderer.free()


def test_of_a_missing_file_the_viewport_shows_the_proxy_and_says_so(path: Path) -> None:
    b_object = link(path)
    b_space = next(area.spaces.active for screen in bpy.data.screens for area in screen.areas if area.type == "VIEW_3D")
    known, player = EvaluatedClouds(CloudCache()), SequencePlayer(residency.sequences)

    def shown() -> tuple[Any, tuple[str, ...]]:
        b_depsgraph = bpy.context.evaluated_depsgraph_get()
        (instance,), warnings = viewport_instances(b_depsgraph, b_space, known, player, set())
        return instance.cloud, warnings

    cloud, warnings = shown()
    assert isinstance(cloud, CaptureFile) and warnings == ()
    away = broken(path)
    cloud, warnings = shown()
    assert isinstance(cloud, SplatCloud) and cloud.splat_count == 300
    assert np.allclose(np.sort(cloud.position, axis=0), np.sort(random_cloud(300, degree=2).position, axis=0))
    (warning,) = warnings
    assert warning.startswith(f"garden: the linked file {path} is missing")
    bpy.ops.object.stipple_relink_capture(filepath=str(away))
    assert b_object == bpy.context.object
    cloud, warnings = shown()
    assert isinstance(cloud, CaptureFile) and warnings == ()
