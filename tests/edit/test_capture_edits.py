# SPDX-License-Identifier: GPL-3.0-or-later
"""Edits of a capture that stays in its file: kept small, drawn in every method, written to a copy."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

from stipple.engine.cache_places import CachePlaces
from stipple.engine.capture_file import CaptureFile
from stipple.engine.capture_order import order_of
from stipple.engine.device import choose_device
from stipple.engine.edit.affine import rotation, translation
from stipple.engine.edit.brush import Brush
from stipple.engine.edit.capture_cloud import CaptureCloud
from stipple.engine.edit.capture_edits import CaptureEdits, identity_of
from stipple.engine.edit.duplicate import duplicate
from stipple.engine.edit.edited_capture import EditedCapture
from stipple.engine.edit.edited_copy import write_edited_copy
from stipple.engine.edit.paint_stroke import PaintStroke
from stipple.engine.edit.selection import select_all
from stipple.engine.edit.state import DELETED, HIDDEN, LOCKED, SELECTED
from stipple.engine.edit.transform import transform
from stipple.engine.errors import Cancelled, StippleError
from stipple.engine.formats import read_splats
from stipple.engine.renderer import Renderer
from stipple.engine.scene import Instance, Scene, SplatStates
from stipple.engine.settings import Settings
from stipple.engine.splats import ARRAY_NAMES, SplatCloud
from tests.capture_files import PLACES, cache_of
from tests.edit.edited_captures import (
    COUNT,
    as_cloud,
    capture_of,
    edited,
    edited_as_usual,
    rows,
    silent,
    unpacked,
)
from tests.scenes import front_camera

ALL_FLAGS = SELECTED | HIDDEN | DELETED | LOCKED


@pytest.fixture(params=[0, 2], ids=["degree 0", "degree 2"])
def capture(request: pytest.FixtureRequest, tmp_path: Path) -> CaptureFile:
    return capture_of(tmp_path, request.param)


def test_splats_are_unpacked_in_the_order_of_the_file(capture: CaptureFile, device: str) -> None:
    cloud, source = unpacked(capture, device), read_splats(capture.path).cloud
    assert cloud.splat_count == COUNT
    assert np.abs(cloud.host("position") - source.position).max() < 1e-5
    assert np.abs(cloud.host("opacity") - source.opacity).max() < 0.0021
    assert cloud.rest_count == 0 and not cloud.has("paint")


def test_the_order_is_the_same_from_the_cache_and_from_the_file(capture: CaptureFile, device: str) -> None:
    warp_device = choose_device(device)
    held = capture.upload(warp_device, silent)
    kept = order_of(capture, warp_device, silent)
    assert cache_of(capture.path).is_file()
    alone = CaptureFile.open(capture.path, CachePlaces(beside=False))
    found = order_of(alone, warp_device, silent)
    assert np.array_equal(kept.numpy(), found.numpy())
    assert len(np.unique(kept.numpy())) == COUNT <= held.splat_count


def test_an_order_that_is_damaged_is_not_worked_out_anew(capture: CaptureFile) -> None:
    """The cache may be of another device, whose rounding this one does not have."""
    held = capture.upload(choose_device("cpu"), silent)
    data = bytearray(cache_of(capture.path).read_bytes())
    data[data.index(b'{"fingerprint"') // 4096 * 4096 - 4096 + 5] ^= 1
    cache_of(capture.path).write_bytes(data)
    with pytest.raises(StippleError, match=r"place_from_source is damaged; delete this cache file"):
        order_of(capture, choose_device("cpu"), silent)
    assert held.splat_count >= COUNT


def test_edits_taken_up_again_give_the_same_cloud(capture: CaptureFile, device: str) -> None:
    live = unpacked(capture, device)
    edits = edited(live)
    again = unpacked(capture, device, edits)
    for name in ("state", "position", "scale", "rotation", "opacity", "sh_dc", "paint", "base_opacity"):
        assert np.array_equal(live.array(name).numpy(), again.array(name).numpy()), name


def test_they_are_what_the_same_edits_make_of_a_cloud_in_memory(capture: CaptureFile, device: str) -> None:
    """But that a transform after a transform is rounded once and not twice."""
    usual = edited_as_usual(as_cloud(capture, device), device)
    cloud = unpacked(capture, device, edited(unpacked(capture, device)))
    assert np.array_equal(cloud.state.numpy(), usual.state.numpy())
    for name in ("position", "scale", "opacity", "sh_dc"):
        assert np.allclose(cloud.host(name), usual.host(name), atol=2e-5), name


def test_they_are_small(capture: CaptureFile, device: str) -> None:
    edits = edited(unpacked(capture, device))
    bits = sum(edits.arrays[name].nbytes for name in ("selected", "hidden", "deleted", "locked"))
    assert bits == 4 * COUNT // 8
    painted, faint, moved = (edits.get(f"{name}_rows").size for name in ("painted", "opacity", "moved"))
    assert min(painted, faint, moved) > 50 and len(edits.matrices) == 2
    assert edits.nbytes == bits + 12 * painted + 8 * faint + 8 * moved + 2 * 96


def test_what_a_step_leaves_alone_is_shared(capture: CaptureFile, device: str) -> None:
    cloud = unpacked(capture, device)
    before = edited(cloud)
    step = select_all(cloud, "invert")
    step.apply(cloud)
    after = cloud.edits_after(step)
    assert [name for name in before.arrays if after.arrays[name] is not before.arrays[name]] == ["selected"]
    assert after.token != before.token


def test_a_map_and_its_inverse_leave_nothing(capture: CaptureFile, device: str) -> None:
    cloud = unpacked(capture, device)
    for offset in ((0.5, 0.25, 1), (-0.5, -0.25, -1)):
        step = transform(cloud, translation(offset), which=cloud.selectable())
        step.apply(cloud)
        cloud.keep(cloud.edits_after(step))
    assert cloud.edits.is_empty


def test_erasing_paint_leaves_nothing(capture: CaptureFile, device: str) -> None:
    cloud = unpacked(capture, device)
    for modes in (("rgb", "erase"), ("opacity", "erase_opacity")):
        for mode in modes:
            stroke = PaintStroke(cloud, Brush(mode=mode, opacity=0.5, falloff="constant"))
            stroke.dab((0, 0, 4), 100.0)
            step = stroke.finish()
            assert step is not None
            cloud.keep(cloud.edits_after(step))
            assert cloud.edits.is_empty == ("erase" in mode)


@pytest.mark.parametrize("mode", ["rgb", "erase", "opacity", "erase_opacity"])
def test_a_stroke_on_edits_taken_up_again_is_one_on_those_that_were_made(
    capture: CaptureFile, device: str, mode: str
) -> None:
    """Paint is unpacked when the second stroke begins, and must not be taken for the unpainted colour."""
    live = unpacked(capture, device)
    again = unpacked(capture, device, edited(live))
    for cloud in (live, again):
        stroke = PaintStroke(cloud, Brush(mode=mode, colour=(0, 0, 1), opacity=0.9, strength=0.5))
        stroke.dab((0, 0, 4), 2.0)
        step = stroke.finish()
        assert step is not None and step.changed > 50
        cloud.keep(cloud.edits_after(step))
    assert live.edits.token == again.edits.token


def test_a_step_that_adds_splats_is_refused(capture: CaptureFile, device: str) -> None:
    cloud = unpacked(capture, device)
    select_all(cloud).apply(cloud)
    with pytest.raises(StippleError, match="Duplicate adds splats, which the edits of a linked capture cannot hold"):
        cloud.edits_after(duplicate(cloud))


def picture(instances: tuple[Instance, ...], method: str, device: str, **options: object) -> np.ndarray:
    settings = Settings(method=method, samples=16, device=device, **options)
    return Renderer(device).render(Scene(instances, (0.1, 0.2, 0.3)), front_camera(), settings).rgba[..., :3]


def psnr(left: np.ndarray, right: np.ndarray) -> float:
    return float(-10 * np.log10(np.mean(np.square(left.astype(np.float64) - right)) + 1e-20))


@pytest.mark.parametrize("seen", [DELETED, ALL_FLAGS], ids=["final", "editing"])
@pytest.mark.parametrize("method", ["sorted", "rays"])
@pytest.mark.parametrize("storage", ["full", "quantised"])
def test_the_picture_is_that_of_the_same_edits_in_memory(
    capture: CaptureFile, device: str, method: str, seen: int, storage: str
) -> None:
    usual = edited_as_usual(as_cloud(capture, device), device)
    values = SplatCloud(**{name: usual.host(name).copy() for name in ARRAY_NAMES})
    states = SplatStates(usual.state.numpy() & np.uint32(seen))
    edits = edited(unpacked(capture, device))
    instances = EditedCapture(capture, edits).instances(Instance(capture), seen)
    expected = picture((Instance(values, states=states),), method, device)
    found = picture(instances, method, device, storage=storage)
    assert psnr(found, expected) > 60
    assert psnr(found, picture((Instance(capture),), method, device)) < 30


def test_points_converge_to_the_same_picture(capture: CaptureFile, device: str) -> None:
    """Two seeds of the one differ as much as the two do."""
    usual = edited_as_usual(as_cloud(capture, device), device)
    values = SplatCloud(**{name: usual.host(name).copy() for name in ARRAY_NAMES})
    states = SplatStates(usual.state.numpy())
    edits = edited(unpacked(capture, device))
    instances = EditedCapture(capture, edits).instances(Instance(capture), ALL_FLAGS)
    expected = picture((Instance(values, states=states),), "points", device)
    noise = psnr(picture((Instance(values, states=states),), "points", device, seed=1), expected)
    assert psnr(picture(instances, "points", device, seed=2), expected) > noise - 0.5
    assert psnr(picture((Instance(capture),), "points", device, seed=2), expected) < noise - 3


def test_flags_alone_need_no_second_cloud_and_no_second_upload(capture: CaptureFile) -> None:
    states = np.where(rows(COUNT, 0, 3), HIDDEN | DELETED, 0).astype(np.uint32)
    empty = CaptureEdits(identity_of(capture.fingerprint), COUNT)
    edited_capture = EditedCapture(capture, empty.with_states(states))
    (instance,) = edited_capture.instances(Instance(capture), DELETED)
    assert instance.cloud is capture and instance.states is not None
    assert edited_capture.instances(Instance(capture), SELECTED)[0].states is None
    renderer = Renderer("cpu")
    scene = Scene((instance, Instance(capture)))
    cut, whole = renderer.device_clouds(scene, "full", silent)
    assert cut.packed_geometry.ptr == whole.packed_geometry.ptr and whole.state is None
    assert np.count_nonzero(cut.state.numpy()) == COUNT // 3


def test_a_copy_has_the_files_own_values_with_the_edits(capture: CaptureFile, tmp_path: Path) -> None:
    edits = edited(unpacked(capture, "cpu"))
    usual = edited_as_usual(read_splats(capture.path).cloud, "cpu")
    path = tmp_path / "copy.ply"
    count = write_edited_copy(capture, edits, path)
    copy, expected = read_splats(path).cloud, usual.to_cloud()
    assert copy.splat_count == expected.splat_count == count == COUNT - edits.counts["deleted"]
    for name in ARRAY_NAMES:
        painted = name in ("sh_dc", "sh_rest", "opacity")
        # Paint was mixed with quantised values, and at the edge of a dab it meets quantised means.
        close = np.isclose(getattr(copy, name), getattr(expected, name), rtol=1e-4, atol=3e-3 if painted else 2e-4)
        assert close.reshape(count, -1).all(1).mean() > (0.98 if painted else 0.9999), name


def test_a_copy_of_nothing_is_the_capture(capture: CaptureFile, tmp_path: Path) -> None:
    empty = CaptureEdits(identity_of(capture.fingerprint), COUNT)
    write_edited_copy(capture, empty, tmp_path / "copy.ply")
    copy, source = read_splats(tmp_path / "copy.ply").cloud, read_splats(capture.path).cloud
    for name in ARRAY_NAMES:
        assert np.allclose(getattr(copy, name), getattr(source, name), rtol=1e-5, atol=1e-6), name


def test_a_copy_of_the_selection(capture: CaptureFile, tmp_path: Path) -> None:
    edits = edited(unpacked(capture, "cpu"))
    cloud = unpacked(capture, "cpu", edits)
    count = write_edited_copy(capture, edits, tmp_path / "copy.ply", selected_only=True)
    assert count == cloud.selection().count() == edits.counts["selected"] > 0
    assert read_splats(tmp_path / "copy.ply").cloud.splat_count == count


def test_a_copy_never_replaces_the_capture_and_is_never_half_there(capture: CaptureFile, tmp_path: Path) -> None:
    edits = edited(unpacked(capture, "cpu"))
    before = sorted(os.listdir(tmp_path))
    os.symlink(capture.path, tmp_path / "link.ply")
    for path in (capture.path, tmp_path / "link.ply"):
        with pytest.raises(StippleError, match="this is the capture itself"):
            write_edited_copy(capture, edits, path)
    os.unlink(tmp_path / "link.ply")
    for error in (Cancelled, KeyboardInterrupt):

        def cancel(fraction: float, text: str, error: type[BaseException] = error) -> None:
            raise error

        with pytest.raises(error):
            write_edited_copy(capture, edits, tmp_path / "copy.ply", cancel)
    everything = edits.with_states(np.full(COUNT, DELETED, np.uint32))
    with pytest.raises(StippleError, match="no splats are left"):
        write_edited_copy(capture, everything, tmp_path / "copy.ply")
    assert sorted(os.listdir(tmp_path)) == before


def test_edits_of_another_capture_are_refused_everywhere(capture: CaptureFile, tmp_path: Path) -> None:
    (tmp_path / "other").mkdir()
    other = capture_of(tmp_path / "other", capture.sh_degree, count=COUNT + 1)
    edits = edited(unpacked(capture, "cpu"))
    for use in (
        lambda: EditedCapture(other, edits),
        lambda: CaptureCloud(other, choose_device("cpu"), edits, silent),
        lambda: write_edited_copy(other, edits, tmp_path / "copy.ply"),
    ):
        with pytest.raises(StippleError, match="made on a file of other content; put that file back, or discard"):
            use()
    os.utime(capture.path, ns=(1, 1))  # a copied file has another date
    assert EditedCapture(CaptureFile.open(capture.path, PLACES), edits).rows is not None


def test_harmonics_turn_with_their_splats(tmp_path: Path, device: str) -> None:
    """Everything turned about the eye, seen through a camera that turned along, is the same picture."""
    capture = capture_of(tmp_path, 3)
    turn = rotation((0, 1, 0), 0.4)
    cloud = unpacked(capture, device)
    step = transform(cloud, turn, which=cloud.selectable())
    step.apply(cloud)
    instances = EditedCapture(capture, cloud.edits_after(step)).instances(Instance(capture), DELETED)
    camera = front_camera(camera_from_world=np.column_stack([turn[:, :3].T, np.zeros(3)]))
    settings = Settings(method="sorted", device=device)
    found = Renderer(device).render(Scene(instances, (0, 0, 0)), camera, settings).rgba[..., :3]
    assert psnr(found, _black(capture, device)) > 50


def _black(capture: CaptureFile, device: str) -> np.ndarray:
    settings = Settings(method="sorted", device=device)
    return Renderer(device).render(Scene((Instance(capture),), (0, 0, 0)), front_camera(), settings).rgba[..., :3]
