# SPDX-License-Identifier: GPL-3.0-or-later
"""Transform the selection, or a whole capture: means, scales, rotations and view-dependent colour."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ..device import choose_device
from ..splats import SplatCloud
from .affine import Matrix, checked, in_object_space
from .editable_cloud import EditableCloud
from .mask import Mask
from .rows import copy_rows, no_rows, scratch_rows
from .selection import selected_or_refuse
from .step import Step
from .transform_diff import KeptDiff, kept_diff, show_mapped, transform_diff
from .transform_kernels import SplatMap


def transform(
    cloud: EditableCloud,
    new_from_old: npt.ArrayLike,
    world_from_object: npt.ArrayLike | None = None,
    which: Mask | None = None,
    name: str = "Transform",
    keep_values: bool = False,
) -> Step:
    """The step that maps the selection, or of `which` what is shown and unlocked, by `new_from_old` (3, 4, world).

    Exact for rotation, uniform scale, mirroring and translation, to the rounding of float32. Uneven scale and shear are
    exact for means and shapes; view-dependent colour then follows the rotation next to the map. `affine` makes maps
    about a pivot. Undo restores every bit. With `keep_values` the step holds the old values themselves (`KeptDiff`).

    Raises StippleError when nothing is selected, a matrix flattens, or memory runs out.
    """
    matrix = in_object_space(checked(new_from_old, f"{cloud.name}: the transform"), world_from_object)
    chosen = selected_or_refuse(cloud, "transform") if which is None else which & cloud.selectable()
    forward = splat_map(cloud, matrix)
    if keep_values:
        return Step(name, (kept_diff(cloud, forward, chosen),), chosen.count())
    rows = chosen.indices()
    old = {part: cloud.array(part) for part in forward.parts}
    return Step(name, (transform_diff(cloud, forward, chosen, old, rows),), int(rows.size))


class TransformDrag:
    """A transform that follows the mouse: always of the values at its start, one step at the end.

    `update` shows a map (3, 4) in the world; `finish` returns the step, its changes already made, for `History.record`,
    or None where nothing moved; `cancel` puts back every bit. Holds a copy of the selection's values meanwhile.

    Raises StippleError when nothing is selected or memory runs out.
    """

    def __init__(
        self, cloud: EditableCloud, world_from_object: npt.ArrayLike | None = None, name: str = "Transform"
    ) -> None:
        self._cloud, self._world_from_object, self._name = cloud, world_from_object, name
        self._which = selected_or_refuse(cloud, "transform")
        self._rows = self._which.indices()
        parts = ["position", "scale", "rotation"] + ["base_rest"] * bool(cloud.rest_count)
        arrays = {part: cloud.writable(part) for part in parts if cloud.has(part) or part == "base_rest"}
        self._old = scratch_rows(arrays, self._rows.size, cloud.device, "a transform")
        self._all = no_rows(cloud.device)
        copy_rows(self._rows.size, self._rows, arrays, self._all, self._old)
        self._last: SplatMap | None = None

    def update(self, new_from_old: npt.ArrayLike) -> None:
        """Show the selection under a map; the last one counts. Raises StippleError for one that flattens."""
        matrix = checked(new_from_old, f"{self._cloud.name}: the transform")
        forward = splat_map(self._cloud, in_object_space(matrix, self._world_from_object))
        targets = {part: self._cloud.array(part) for part in forward.parts}
        changed = set(forward.parts)
        if self._last is not None and set(self._last.parts) - changed:
            self._put_back()  # an earlier map changed what this one does not
            changed |= set(self._last.parts)
        forward.run(self._rows.size, self._all, self._old, self._rows, targets)
        self._last = forward
        show_mapped(self._cloud, changed, self._rows)

    def finish(self, keep_values: bool = False) -> Step | None:
        """`keep_values` as `transform` has it: the copy goes into the step, and there is nothing to work out."""
        if self._last is None or np.array_equal(self._last.matrix, np.eye(3, 4)):
            self.cancel()
            return None
        old = {part: self._old[part] for part in self._last.parts}
        if keep_values:
            return Step(self._name, (KeptDiff(self._last, self._which, old),), int(self._rows.size))
        try:
            diff = transform_diff(self._cloud, self._last, self._which, old, self._all)
        except BaseException:
            self.cancel()
            raise
        return Step(self._name, (diff,), int(self._rows.size))

    def cancel(self) -> None:
        if self._last is not None:
            self._put_back()
            show_mapped(self._cloud, set(self._old), self._rows)
            self._last = None

    def _put_back(self) -> None:
        targets = {part: self._cloud.array(part) for part in self._old}
        copy_rows(self._rows.size, self._all, self._old, self._rows, targets)


def splat_map(cloud: EditableCloud, matrix: Matrix) -> SplatMap:
    """The map, checked against what the cloud has. Raises StippleError where it turns harmonics that are not loaded."""
    forward = SplatMap(matrix, cloud.sh_degree, cloud.device)
    if forward.turns:
        cloud.array("sh_rest")
    return forward


def transform_cloud(cloud: SplatCloud, new_from_old: npt.ArrayLike) -> SplatCloud:
    """The cloud whose picture, untransformed, is that of `cloud` under `new_from_old` (3, 4). As `transform` has it.

    Raises StippleError when the map is not finite or flattens the cloud.
    """
    matrix = checked(new_from_old, f"{cloud.name}: the transform")
    device = choose_device("cpu")
    editable = EditableCloud.from_cloud(cloud, device)
    forward = SplatMap(matrix, cloud.sh_degree, device)
    arrays = {part: editable.writable(part) for part in forward.parts}
    forward.run(cloud.splat_count, no_rows(device), arrays, no_rows(device), arrays)
    return editable.to_cloud()
