# SPDX-License-Identifier: GPL-3.0-or-later
"""Painting: what NumPy makes of the same strokes in float64, harmonics included, and the way back."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from stipple.engine import device as engine_device
from stipple.engine.edit.affine import rotation
from stipple.engine.edit.brush import FALLOFFS, MODES, Brush
from stipple.engine.edit.editable_cloud import EditableCloud
from stipple.engine.edit.flags import hide, lock
from stipple.engine.edit.history import History
from stipple.engine.edit.mask import mask_from_numpy
from stipple.engine.edit.paint_stroke import PaintStroke
from stipple.engine.edit.selection import select, select_all
from stipple.engine.edit.transform import transform
from stipple.engine.splats import SH_C0
from tests.edit.every_byte import assert_same, every_byte
from tests.edit.strokes import COLOUR, DABS, stroke

Clouds = Callable[..., EditableCloud]

STEP = 4 / 65535  # of a painted base colour


def colours(cloud: EditableCloud, name: str = "sh_dc") -> np.ndarray:
    return 0.5 + SH_C0 * cloud.host(name).astype(np.float64)


def amounts(cloud: EditableCloud, brush: Brush) -> np.ndarray:
    """Coverage after `DABS`, without the 16 bits."""
    curves = {
        "smooth": lambda t: t * t * (3 - 2 * t),
        "sphere": lambda t: np.sqrt(2 * t - t * t),
        "linear": lambda t: t,
        "sharp": lambda t: t * t,
        "constant": np.ones_like,
    }
    total = np.zeros(cloud.splat_count)
    for centre, radius in DABS:
        far = np.linalg.norm(cloud.host("position").astype(np.float64) - centre, axis=1) / radius
        dab = np.where(far <= 1, brush.strength * curves[brush.falloff](np.clip(1 - far, 0, 1)), 0)
        total = total + (1 - total) * dab if brush.build_up else np.maximum(total, dab)
    return total


def unpaintable_edge(cloud: EditableCloud) -> np.ndarray:
    """Splats so close to a dab's edge that rounding decides."""
    means = cloud.host("position").astype(np.float64)
    from_edges = [np.linalg.norm(means - centre, axis=1) - radius for centre, radius in DABS]
    return np.abs(from_edges).min(axis=0) < 1e-4


def wanted_colours(old: np.ndarray, a: np.ndarray, mode: str) -> np.ndarray:
    a = a[:, None]
    return {
        "rgb": old + a * (np.array(COLOUR) - old),
        "hue_saturation": old + a * (old.max(axis=1, keepdims=True) * np.array(COLOUR) / max(COLOUR) - old),
        "darken": old * (1 - a),
        "lighten": old * (1 + a),
    }[mode]


@pytest.mark.parametrize("build_up", [False, True])
@pytest.mark.parametrize("falloff", FALLOFFS)
def test_falloff_and_coverage(make_cloud: Clouds, falloff: str, build_up: bool) -> None:
    cloud = make_cloud()
    old = colours(cloud)
    brush = Brush("rgb", COLOUR, strength=0.6, falloff=falloff, build_up=build_up)
    stroke(cloud, brush)
    a = amounts(cloud, brush)
    assert 0.1 < (a > 0).mean() < 0.9
    clear = ~unpaintable_edge(cloud)
    wanted = wanted_colours(old, a, "rgb")
    np.testing.assert_allclose(colours(cloud)[clear], wanted[clear], atol=STEP + 6e-5)


@pytest.mark.parametrize("mode", ["rgb", "hue_saturation", "darken", "lighten"])
def test_colour_and_harmonics(make_cloud: Clouds, mode: str) -> None:
    """The base colour within half a step of 16 bits; the harmonics by the module's formula, to 1/128 of themselves."""
    cloud = make_cloud(3000, 1, 3)
    old, rest = colours(cloud), cloud.host("sh_rest").astype(np.float64)
    brush = Brush(mode, COLOUR, strength=0.7)
    stroke(cloud, brush)
    a, clear = amounts(cloud, brush), ~unpaintable_edge(cloud)
    wanted = wanted_colours(old, a, mode)
    np.testing.assert_allclose(colours(cloud)[clear], wanted[clear], atol=STEP)
    own = {"rgb": 1 - a, "hue_saturation": 1 - a, "darken": 1 - a, "lighten": 1 + a}[mode]
    value = np.ones_like(a) if mode == "hue_saturation" else own
    tint = np.maximum(wanted, 0) / wanted.max(axis=1, keepdims=True)
    brightest = np.take_along_axis(rest, old.argmax(axis=1)[:, None, None], axis=2)
    harmonics = own[:, None, None] * rest + (value - own)[:, None, None] * brightest * tint[:, None, :]
    clear &= np.sort(wanted, axis=1)[:, -1] > 0.05
    step = np.abs(rest).max(axis=(1, 2), keepdims=True) * 2 / 128 + 1e-6
    assert (np.abs(cloud.host("sh_rest") - harmonics) <= step)[clear].all()
    untouched = (a == 0) & clear
    assert np.array_equal(cloud.host("sh_rest")[untouched], cloud.host("base_rest")[untouched])


def test_desaturated_splats_keep_no_coloured_highlights(make_cloud: Clouds) -> None:
    """The paper's figure 12: from every direction a splat painted grey is grey, yet keeps a highlight."""
    from tests.oracle.sh import basis

    cloud = make_cloud(500, 1, 4)
    directions = np.random.default_rng(1).normal(size=(50, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    shapes = basis(directions, 4)

    def seen() -> np.ndarray:
        coefficients = np.concatenate([cloud.host("sh_dc")[:, None], cloud.host("sh_rest")], axis=1)
        return 0.5 + np.einsum("dk,nkc->ndc", shapes, coefficients.astype(np.float64))

    before = seen()
    stroke(cloud, Brush("hue_saturation", (0.5, 0.5, 0.5), falloff="constant"), [((0, 0, 4), 100.0)])
    after = seen()
    assert np.ptp(before, axis=2).mean() > 0.1
    assert np.ptp(after, axis=2).max() < 1e-3
    value = before[:, :, :].max(axis=2) - before.max(axis=2).mean(axis=1, keepdims=True)
    kept = after.max(axis=2) - after.max(axis=2).mean(axis=1, keepdims=True)
    assert np.corrcoef(value.ravel(), kept.ravel())[0, 1] > 0.7
    stroke(cloud, Brush("rgb", COLOUR, falloff="constant"), [((0, 0, 4), 100.0)])
    np.testing.assert_allclose(seen(), np.broadcast_to(COLOUR, after.shape), atol=STEP)


def test_overlapping_dabs_do_not_saturate(make_cloud: Clouds) -> None:
    cloud = make_cloud()
    brush = Brush("rgb", COLOUR, strength=0.2)
    stroke(cloud, brush, DABS)
    once = every_byte(cloud)
    again = make_cloud()
    stroke(again, brush, [*DABS * 40, *DABS[::-1]])
    assert_same(again, once)


def test_the_weakest_airbrush_arrives(make_cloud: Clouds) -> None:
    """16 bits: a strength of 1/1000 that builds up over 10,000 dabs, and 1,000 weak strokes one after the other."""
    cloud = make_cloud(50, 1, 2)
    ball = [((0, 0, 4), 100.0)]
    stroke(cloud, Brush("rgb", COLOUR, strength=0.001, falloff="constant", build_up=True), ball * 10_000)
    np.testing.assert_allclose(colours(cloud), np.broadcast_to(COLOUR, (50, 3)), atol=2e-3)
    assert np.abs(cloud.host("sh_rest")).max() < 0.01
    cloud = make_cloud(50, 1, 2)
    for _ in range(600):
        stroke(cloud, Brush("rgb", COLOUR, strength=0.01, falloff="constant"), ball)
    np.testing.assert_allclose(colours(cloud), np.broadcast_to(COLOUR, (50, 3)), atol=100 * STEP)
    assert np.abs(cloud.host("sh_rest")).max() < 1e-6


@pytest.mark.parametrize("mode", MODES)
def test_undo_restores_every_bit_for_twelve_bytes(make_cloud: Clouds, mode: str) -> None:
    cloud = make_cloud(3000, 1, 3)
    history = History(cloud)
    for first in ("rgb", "opacity"):
        history.record(stroke(cloud, Brush(first, (0.2, 0.3, 0.9), opacity=0.9), [((0.2, 0, 4), 2.0)]).finish())
    before = every_byte(cloud)
    cancelled = stroke(cloud, Brush(mode, COLOUR, 0.3, 0.5))
    cancelled.cancel()
    assert_same(cloud, before)
    step = stroke(cloud, Brush(mode, COLOUR, 0.3, 0.5)).finish()
    after = every_byte(cloud)
    assert after != before
    assert step.nbytes <= 12 * step.changed + 64
    history.record(step)
    for _ in range(3):
        history.undo()
        assert_same(cloud, before)
        history.redo()
        assert_same(cloud, after)


def test_erasing_gives_the_original_bits_back(make_cloud: Clouds) -> None:
    cloud = make_cloud(1000, 1, 3)
    before = every_byte(cloud)
    ball = [((0, 0, 4), 100.0)]
    for mode in ("rgb", "hue_saturation", "darken", "opacity"):
        stroke(cloud, Brush(mode, COLOUR, 0.2, 0.8))
    half = colours(cloud)
    stroke(cloud, Brush("erase", strength=0.5, falloff="constant"), ball)
    middle = (half + colours(cloud, "base_dc")) / 2
    np.testing.assert_allclose(colours(cloud), middle, atol=2 * STEP)
    stroke(cloud, Brush("erase", falloff="constant"), ball)
    stroke(cloud, Brush("erase_opacity", falloff="constant"), ball)
    assert_same(cloud, before)


def test_opacity(make_cloud: Clouds) -> None:
    cloud = make_cloud()
    old, brush = cloud.host("opacity").astype(np.float64), Brush("opacity", opacity=0.1, strength=0.8)
    stroke(cloud, brush)
    a, clear = amounts(cloud, brush), ~unpaintable_edge(cloud)
    np.testing.assert_allclose(cloud.host("opacity")[clear], (old + a * (0.1 - old))[clear], atol=2e-5)


def test_only_what_is_shown_unlocked_and_asked_for(make_cloud: Clouds) -> None:
    cloud = make_cloud(1000)
    history, before = History(cloud), cloud.host("sh_dc").copy()
    rng = np.random.default_rng(3)
    hidden, locked, within = (rng.random(1000) < 0.3 for _ in range(3))
    for mask, operation in ((hidden, hide), (locked, lock)):
        history.do(select(cloud, mask_from_numpy(mask, cloud.device)))
        history.do(operation(cloud))
    stroke(
        cloud,
        Brush("rgb", COLOUR, falloff="constant"),
        [((0, 0, 4), 99.0)],
        within=mask_from_numpy(within, cloud.device),
    )
    changed = (cloud.host("sh_dc") != before).any(axis=1)
    np.testing.assert_array_equal(changed, within & ~hidden & ~locked)


def test_paint_turns_with_the_splats(make_cloud: Clouds) -> None:
    """Painting and turning commute, and undo takes both back in order."""
    turn = rotation((1, 2, 3), 0.8, (0, 0, 4))
    results = []
    for order in ("paint first", "turn first"):
        cloud = make_cloud(500, 1, 3)
        history = History(cloud)
        history.do(select_all(cloud))
        states = [every_byte(cloud)]
        for what in ("paint", "turn") if order == "paint first" else ("turn", "paint"):
            if what == "turn":
                history.do(transform(cloud, turn))
            else:
                history.record(
                    stroke(cloud, Brush("hue_saturation", COLOUR, strength=0.6), [((0, 0, 4), 50.0)]).finish()
                )
            states.append(every_byte(cloud))
        results.append(cloud.host("sh_rest").copy())
        for state in states[1::-1]:
            history.undo()
            assert_same(cloud, state)
        history.go_to(3)
        assert_same(cloud, states[2])
    np.testing.assert_allclose(results[0], results[1], atol=1e-5)


def test_late_harmonics_are_the_same(make_cloud: Clouds) -> None:
    clouds = [make_cloud(1000, 1, 2) for _ in range(2)]
    for cloud, harmonics in zip(clouds, (True, False), strict=True):
        one = PaintStroke(cloud, Brush("rgb", COLOUR, strength=0.5))
        for centre, radius in DABS:
            one.dab(centre, radius, harmonics)
        one.finish()
    assert_same(clouds[1], every_byte(clouds[0]))


def test_threads_change_no_bit(make_cloud: Clouds) -> None:
    before, results = engine_device.thread_count(), []
    try:
        for threads in (1, 2, 5):
            engine_device.set_thread_count(threads)
            cloud = make_cloud(60_000, 1, 1)
            step = stroke(cloud, Brush("hue_saturation", COLOUR, build_up=True)).finish()
            results.append((every_byte(cloud), step.nbytes))
    finally:
        engine_device.set_thread_count(before)
    assert results[0] == results[1] == results[2]
