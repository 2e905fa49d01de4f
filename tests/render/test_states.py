# SPDX-License-Identifier: GPL-3.0-or-later
"""Clouds under the flags of an edit: hidden and deleted splats are not drawn, selected ones are tinted."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from stipple.engine.camera import Camera
from stipple.engine.edit.state import DELETED, HIDDEN, LOCKED, SELECTED
from stipple.engine.edit.state_bits import HIGHLIGHT
from stipple.engine.renderer import Renderer
from stipple.engine.scene import Instance, Scene, SplatStates
from stipple.engine.settings import Settings
from stipple.engine.splats import ARRAY_NAMES, SH_C0, SplatCloud

CAMERA = Camera(np.hstack([np.eye(3), [[0], [0], [4.0]]]), 80, 60, 90.0, 90.0, 40.0, 30.0)
METHODS = ["sorted", "points", "rays"]


def cloud_of(count: int = 400) -> SplatCloud:
    """Splats without harmonics, so that a tint can be put into the base colour."""
    rng = np.random.default_rng(7)
    rotation = rng.normal(size=(count, 4))
    arrays = (
        rng.uniform(-1, 1, (count, 3)),
        0.06 * np.exp(rng.normal(0, 0.4, (count, 3))),
        rotation / np.linalg.norm(rotation, axis=1, keepdims=True),
        rng.uniform(0.3, 1, count),
        rng.uniform(-1.5, 1.5, (count, 3)),
        np.zeros((count, 0, 3)),
    )
    values = (np.ascontiguousarray(array, np.float32) for array in arrays)
    return SplatCloud(**dict(zip(ARRAY_NAMES, values, strict=True)))


def picture(cloud: SplatCloud, states: np.ndarray | None, method: str, **options: object) -> np.ndarray:
    held = None if states is None else SplatStates(states.astype(np.uint32))
    settings = Settings(method=method, samples=2, device="cpu", **options)
    return Renderer("cpu").render(Scene((Instance(cloud, states=held),), (0.2, 0.3, 0.1)), CAMERA, settings).rgba


@pytest.mark.parametrize("method", METHODS)
def test_hidden_and_deleted_splats_are_not_drawn(method: str) -> None:
    cloud, states = cloud_of(), np.zeros(400)
    states[::3], states[1::3] = HIDDEN, DELETED | SELECTED
    opacity = np.where(states == 0, cloud.opacity, 0).astype(np.float32)
    expected = picture(replace(cloud, opacity=opacity), None, method)
    assert np.array_equal(picture(cloud, states, method), expected)
    assert np.abs(expected - picture(cloud, None, method)).max() > 0.1


@pytest.mark.parametrize("method", METHODS)
def test_selected_splats_are_tinted(method: str) -> None:
    cloud, states = cloud_of(), np.zeros(400)
    states[::2], states[1::4] = SELECTED, SELECTED | LOCKED
    colour = np.maximum(0.5 + SH_C0 * cloud.sh_dc, 0)
    tinted = (0.5 * (colour + HIGHLIGHT) - 0.5) / SH_C0
    sh_dc = np.where((states == SELECTED)[:, None], tinted, cloud.sh_dc).astype(np.float32)
    expected = picture(replace(cloud, sh_dc=sh_dc), None, method)
    assert np.abs(picture(cloud, states, method) - expected).max() < 1e-5
    assert np.abs(expected - picture(cloud, None, method)).max() > 0.1


def test_a_quantised_scene_keeps_what_is_edited_in_full() -> None:
    """Quantised clouds lie in another order, in which flags would mean other splats."""
    cloud, states = cloud_of(), np.zeros(400)
    states[:200] = HIDDEN
    assert np.array_equal(picture(cloud, states, "sorted", storage="quantised"), picture(cloud, states, "sorted"))


def test_a_change_of_states_uploads_no_splats() -> None:
    renderer, cloud, uploads = Renderer("cpu"), cloud_of(), []
    settings = Settings(method="sorted", device="cpu")
    pictures = []
    for flag in (0, HIDDEN, 0):
        scene = Scene((Instance(cloud, states=SplatStates(np.full(400, flag, np.uint32))),), (0.2, 0.3, 0.1))
        pictures.append(renderer.render(scene, CAMERA, settings).rgba)
        uploads.append(renderer.device_clouds(scene, "full", lambda fraction, text: None)[0].position.ptr)
        assert len(renderer._clouds) == len(renderer._states) == 1
    assert len(set(uploads)) == 1
    assert np.array_equal(pictures[0], pictures[2]) and not np.array_equal(pictures[0], pictures[1])
