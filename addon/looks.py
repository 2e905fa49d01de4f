# SPDX-License-Identifier: GPL-3.0-or-later
"""From `object.stipple` as the depsgraph evaluates it to the engine's Look.

An instance has the look of the object that is instanced, its crops included: all instances of an object are cropped as
the object itself is where it stands.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from ..engine.look import MOST_CROPS, Crop, Look
from .crop_places import CropPlaces

Matrix = npt.NDArray[np.float64]

ALL_SH_DEGREES = 4
ANTIALIASED = {"SCENE": None, "ON": True, "OFF": False}


@dataclass(frozen=True, eq=False)
class _Source:
    """What was read of an object: its look with crops where they stand, and where it stands itself."""

    look: Look
    matrix: Matrix  # (4, 4)


class LookReader:
    """Reads the looks of one depsgraph, each object's once; `notices` says what could not be used."""

    def __init__(self, depsgraph: Any, working_space: str) -> None:
        self.notices: dict[str, None] = {}
        self._depsgraph, self._working_space = depsgraph, working_space
        self._sources: dict[int, _Source] = {}
        self._places = CropPlaces(depsgraph)

    def look_of(self, b_instance: Any) -> Look:
        """The look of one of `depsgraph.object_instances`."""
        b_source = b_instance.object.original.evaluated_get(self._depsgraph)
        uid = b_source.original.session_uid  # evaluated copies have none
        if uid not in self._sources:
            self._sources[uid] = _Source(self._read(b_source), np.array(b_source.matrix_world, np.float64))
        source = self._sources[uid]
        if not b_instance.is_instance or not source.look.crops:
            return source.look
        moved = np.array(b_instance.matrix_world, np.float64) @ np.linalg.pinv(source.matrix)
        crops = tuple(
            replace(crop, world_from_crop=_rows(moved @ [*crop.world_from_crop, (0.0, 0.0, 0.0, 1.0)]))
            for crop in source.look.crops
        )
        return replace(source.look, crops=crops)

    def look_of_object(self, b_object: Any) -> Look:
        """The look of an object where it stands itself."""
        return self._read(b_object.original.evaluated_get(self._depsgraph))

    def _read(self, b_object: Any) -> Look:
        b_stipple = b_object.stipple
        return Look(
            gain=tuple(b_stipple.gain),
            exposure=b_stipple.exposure,
            saturation=b_stipple.saturation,
            tint=tuple(b_stipple.tint),
            tint_factor=b_stipple.tint_factor,
            working_space=self._working_space,
            opacity=b_stipple.opacity,
            size=b_stipple.size,
            sh_degree=None if b_stipple.sh_degree == ALL_SH_DEGREES else b_stipple.sh_degree,
            antialiased=ANTIALIASED[b_stipple.antialiased],
            crops=self._crops(b_object),
            display=b_stipple.display.lower(),
            point_px=b_stipple.point_size,
            least_opacity=b_stipple.least_opacity,
        )

    def _crops(self, b_object: Any) -> tuple[Crop, ...]:
        crops = []
        for index, b_crop in enumerate(b_object.stipple.crops):
            if not b_crop.use:
                continue
            if _is_deleted(b_crop.object):
                self._notice(f"{b_object.name}: crop {index + 1} has no object any more and is ignored.")
                continue
            b_volume = b_crop.object.original.evaluated_get(self._depsgraph)
            if self._places.stands_still(b_volume):
                self._notice(f"{b_object.name}: the crop object {b_volume.name} {_why_it_stands_still(b_volume)}.")
            volume = local_box(b_volume)
            if np.diagonal(volume).min() == 0.0:
                self._notice(
                    f"{b_object.name}: the crop object {b_volume.name} is flat and holds nothing; give it a thickness."
                )
            matrix = self._places.matrix_of(b_volume) @ volume
            crops.append(Crop(_rows(matrix), b_crop.shape.lower(), b_crop.keep.lower()))
        if len(crops) > MOST_CROPS:
            self._notice(f"{b_object.name}: {len(crops)} crops are in use, the first {MOST_CROPS} of them crop.")
        return tuple(crops[:MOST_CROPS])

    def _notice(self, text: str) -> None:
        self.notices[text] = None


def _is_deleted(b_volume: Any) -> bool:
    """Whether a crop has lost its object: deleted ones are kept by the crop, in no collection.

    Those of another file are in none here, too, where the capture was linked without their collection.
    """
    if b_volume is None:
        return True
    return b_volume.original.library is None and not b_volume.original.users_collection


def _why_it_stands_still(b_volume: Any) -> str:
    if not b_volume.original.users_collection:
        return "is in no collection here and does not move; link its collection, too"
    return "is disabled here and does not move; enable it and let it display as bounds instead"


def local_box(b_object: Any) -> Matrix:
    """(4, 4) from the cube -1 … 1 to the object's local box: an empty's as it is drawn, else the bounding box."""
    matrix = np.eye(4)
    if b_object.type == "EMPTY":
        matrix[:3, :3] *= b_object.empty_display_size
        return matrix
    corners = np.array(b_object.bound_box, np.float64)
    low, high = corners.min(axis=0), corners.max(axis=0)
    if (high > low).any():  # cameras and lights have no box
        matrix[:3, :3] = np.diag((high - low) / 2)
        matrix[:3, 3] = (low + high) / 2
    return matrix


def _rows(matrix: Matrix) -> tuple[tuple[float, ...], ...]:
    return tuple(tuple(row) for row in matrix[:3].tolist())
