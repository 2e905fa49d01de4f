# SPDX-License-Identifier: GPL-3.0-or-later
"""Captures in files, and one sequence of edits that every kind of cloud can go through."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from stipple.engine.capture_file import CaptureFile
from stipple.engine.device import choose_device
from stipple.engine.edit.affine import rotation, scaling, translation
from stipple.engine.edit.brush import Brush
from stipple.engine.edit.capture_cloud import CaptureCloud
from stipple.engine.edit.capture_edits import CaptureEdits
from stipple.engine.edit.editable_cloud import EditableCloud
from stipple.engine.edit.flags import delete, hide, lock
from stipple.engine.edit.mask import mask_from_numpy
from stipple.engine.edit.paint_stroke import PaintStroke
from stipple.engine.edit.selection import select
from stipple.engine.edit.step import Step
from stipple.engine.edit.transform import transform
from stipple.engine.formats import write_splats
from stipple.engine.splats import SplatCloud
from tests.capture_files import PLACES
from tests.scenes import random_cloud

COUNT = 3_000
CENTRE = (0.0, 0.0, 4.0)


def capture_of(folder: Path, sh_degree: int = 2, count: int = COUNT) -> CaptureFile:
    path = folder / "garden.ply"
    write_splats(path, random_cloud(count, 3, sigma_px=(0.5, 2.0), sh_degree=sh_degree))
    return CaptureFile.open(path, PLACES)


def silent(fraction: float, text: str) -> None:
    """Progress that nobody looks at."""


def unpacked(capture: CaptureFile, device: str, edits: CaptureEdits | None = None) -> CaptureCloud:
    return CaptureCloud(capture, choose_device(device), edits, silent)


def rows(count: int, first: int, step: int) -> np.ndarray:
    chosen = np.zeros(count, bool)
    chosen[first::step] = True
    return chosen


def edits_in_turn(cloud: EditableCloud) -> Iterator[Step]:
    """Steps of every kind that keeps the splats, each applied when it is yielded."""

    def done(step: Step) -> Step:
        step.apply(cloud)
        return step

    def chosen(first: int, step: int) -> Step:
        return select(cloud, mask_from_numpy(rows(cloud.splat_count, first, step), cloud.device))

    yield done(chosen(0, 7))
    yield done(transform(cloud, rotation((1, 2, 3), 0.7, CENTRE)))
    yield done(chosen(0, 14))
    yield done(transform(cloud, scaling((1.2, 0.8, 1.5), CENTRE)))
    yield done(transform(cloud, translation((0.1, -0.2, 0.3))))
    for brush, centre, radius in (
        (Brush(mode="rgb", colour=(0.9, 0.2, 0.1), strength=0.8), CENTRE, 1.2),
        (Brush(mode="hue_saturation", colour=(0.1, 0.5, 0.9)), (0.8, 0.3, 4.5), 0.9),
        (Brush(mode="opacity", opacity=0.3), (-0.5, -0.3, 3.5), 1.0),
    ):
        stroke = PaintStroke(cloud, brush)
        stroke.dab(centre, radius)
        step = stroke.finish()
        assert step is not None and step.changed > 10
        yield step
    yield done(chosen(1, 9))
    yield done(delete(cloud))
    yield done(chosen(2, 9))
    yield done(hide(cloud))
    yield done(chosen(3, 9))
    yield done(lock(cloud))
    yield done(chosen(4, 9))


def edited(cloud: CaptureCloud) -> CaptureEdits:
    """The edits once `edits_in_turn` went through."""
    for step in edits_in_turn(cloud):
        cloud.keep(cloud.edits_after(step))
    return cloud.edits


def as_cloud(capture: CaptureFile, device: str) -> SplatCloud:
    """Every splat as quantisation has left it, in the order of the file."""
    everything = np.arange(capture.splat_count, dtype=np.int32)
    cloud = CaptureCloud(capture, choose_device(device), None, silent, everything)
    return cloud.to_cloud()


def edited_as_usual(cloud: SplatCloud, device: str) -> EditableCloud:
    """The same edits on a cloud that the host holds."""
    editable = EditableCloud.from_cloud(cloud, choose_device(device))
    for _ in edits_in_turn(editable):
        pass
    return editable
