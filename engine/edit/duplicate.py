# SPDX-License-Identifier: GPL-3.0-or-later
"""More splats and fewer: duplicate, clone-stamp, append another capture, separate, merge."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from ..errors import StippleError
from ..splats import ARRAY_NAMES, SplatCloud
from .affine import checked, in_object_space
from .append_diff import AppendDiff, CopyDiff, padded_rest
from .editable_cloud import EditableCloud
from .mask import Mask, empty_mask
from .match_space import match_sphere
from .selection import selected_or_refuse
from .state import DELETED, SELECTED, SEPARATED
from .step import FlagDiff, Step


def duplicate(
    cloud: EditableCloud,
    copy_from_original: npt.ArrayLike | None = None,
    world_from_object: npt.ArrayLike | None = None,
) -> Step:
    """The step that copies the selection to the cloud's end, mapped by `copy_from_original` (3, 4) in the world.

    The copies are selected then and the originals are not, so that a transform moves the copies. Copies are painted and
    locked as nothing else is: they keep the paint, and their unpainted colour is the originals'.

    Raises StippleError when nothing is selected, the map flattens, or memory runs out.
    """
    chosen = selected_or_refuse(cloud, "duplicate")
    matrix = in_object_space(checked(copy_from_original, f"{cloud.name}: the copy's transform"), world_from_object)
    return Step("Duplicate", (FlagDiff(SELECTED, chosen), CopyDiff(matrix, chosen)), chosen.count())


def append_cloud(cloud: EditableCloud, other: SplatCloud) -> Step:
    """The step that adds another capture's splats, selected; what was selected no longer is.

    `other` is in this cloud's object space (`transform_cloud` brings it there). Bands that only one of both has are 0
    in the other. Raises StippleError, when it is done, for too little memory.
    """
    return Step("Join", (FlagDiff(SELECTED, cloud.selection()), AppendDiff(other, cloud.rest_count)), other.splat_count)


def separate(cloud: EditableCloud, name: str | None = None) -> tuple[SplatCloud, Step]:
    """The selection as a capture of its own, and `separate_step`. Raises StippleError as that."""
    step = separate_step(cloud)
    return cloud.to_cloud(cloud.selection(), name), step


def separate_step(cloud: EditableCloud) -> Step:
    """The step that deletes the selection for good: undo brings it back, `restore` does not.

    Raises StippleError when nothing is selected, or everything, for then no capture would be left.
    """
    chosen = selected_or_refuse(cloud, "separate")
    if not (cloud.kept() - chosen).count():
        raise StippleError(f"{cloud.name}: every splat is selected, and none would be left here; deselect some.")
    return Step("Separate", (FlagDiff(DELETED | SEPARATED, chosen),), chosen.count())


def merge_clouds(clouds: Sequence[SplatCloud], name: str | None = None) -> SplatCloud:
    """One capture of several that share an object space, in order; bands that one lacks are 0.

    Raises StippleError when there are none, or for too little memory.
    """
    if not clouds:
        raise StippleError("merge: no captures are selected; select two or more.")
    degree = max(cloud.sh_degree for cloud in clouds)
    try:
        values = {
            key: np.concatenate([getattr(cloud, key) for cloud in clouds]) for key in ARRAY_NAMES if key != "sh_rest"
        }
        values["sh_rest"] = np.concatenate([padded_rest(cloud.sh_rest, degree) for cloud in clouds])
    except MemoryError as error:
        total = sum(cloud.splat_count for cloud in clouds)
        raise StippleError(f"merge: {total:,} splats do not fit in memory; merge fewer captures.") from error
    return SplatCloud(**values, name=name or clouds[0].name)


class CloneStroke:
    """A clone stamp: copies what is under the brush at the source to where the brush is, each splat once per stroke.

    `copy_from_source` (3, 4) maps the source's place to the target's, in the world. `dab` copies; `finish` returns the
    step, its changes already made, for `History.record`, or None where nothing was copied; `cancel` takes the copies
    away. The copies are selected then; the selection from before is cleared.
    """

    def __init__(
        self,
        cloud: EditableCloud,
        copy_from_source: npt.ArrayLike,
        world_from_object: npt.ArrayLike | None = None,
        name: str = "Clone",
    ) -> None:
        self._cloud, self._world_from_object, self._name = cloud, world_from_object, name
        self._in_world = checked(copy_from_source, f"{cloud.name}: the clone's transform")
        self._matrix = in_object_space(self._in_world, world_from_object)
        self._deselect = FlagDiff(SELECTED, cloud.selection())
        self._sources = cloud.selectable()  # what may be copied: no copies of copies
        self._copied = empty_mask(cloud.splat_count, cloud.device)
        self._dabs: list[CopyDiff] = []
        self._deselect.apply(cloud)

    def dab(self, target: npt.ArrayLike, radius: float) -> None:
        """Copy what lies within `radius` of the place that is mapped to `target` (3,), in world units.

        When memory runs out the dab copies nothing and StippleError says so; those before it stay.
        """
        linear, offset = self._in_world[:, :3], self._in_world[:, 3]
        source = np.linalg.solve(linear, np.asarray(target, np.float64) - offset)
        under = match_sphere(self._cloud, source, radius, self._world_from_object)
        first = Mask(under.words[: self._copied.words.size], self._copied.splat_count)
        fresh = (first & self._sources) - self._copied
        if fresh.count():
            diff, copied = CopyDiff(self._matrix, fresh), self._copied | fresh
            diff.apply(self._cloud)
            self._dabs.append(diff)
            self._copied = copied

    def finish(self) -> Step | None:
        count = self._copied.count()
        self.cancel()  # as one step, the copies stand in the order of their originals
        if count == 0:
            return None
        step = Step(self._name, (self._deselect, CopyDiff(self._matrix, self._copied)), count)
        step.apply(self._cloud)
        return step

    def cancel(self) -> None:
        while self._dabs:
            self._dabs.pop().revert(self._cloud)
        self._deselect.revert(self._cloud)
