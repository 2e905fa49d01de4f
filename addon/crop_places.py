# SPDX-License-Identifier: GPL-3.0-or-later
"""Where objects that crop stand: as Blender evaluates them, or worked out where it does not.

Blender does not see what the settings of add-ons point to. So it leaves out a crop object that is disabled, in an
excluded collection, or of another file from which the capture alone was linked. Its `matrix_world` then is of when it
was last evaluated in this session, and the identity after a file was opened. Its own transform and its parents' are
known all the same; what animation and constraints would make of them is not.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

Matrix = npt.NDArray[np.float64]
WHOLE_PARENTS = ("OBJECT", "ARMATURE", "LATTICE")  # not a bone or a vertex, which only Blender can place


class CropPlaces:
    """The places of objects in one depsgraph."""

    def __init__(self, depsgraph: Any) -> None:
        self._depsgraph = depsgraph
        self._shown: set[int] | None = None
        self._instanced: set[int] | None = None

    def matrix_of(self, b_object: Any) -> Matrix:
        """(4, 4) from the object to the world."""
        b_original = b_object.original
        if self.is_evaluated(b_original) or _is_placed_by_blender(b_original):
            return np.array(b_original.evaluated_get(self._depsgraph).matrix_world, np.float64)
        own = np.array(b_original.matrix_basis, np.float64)
        if b_original.parent is None:
            return own
        return self.matrix_of(b_original.parent) @ np.array(b_original.matrix_parent_inverse, np.float64) @ own

    def stands_still(self, b_object: Any) -> bool:
        """Whether the object moves in Blender and not here."""
        b_original = b_object.original
        while b_original is not None and not self.is_evaluated(b_original):
            if b_original.animation_data or _is_placed_by_blender(b_original):
                return True
            b_original = b_original.parent
        return False

    def is_evaluated(self, b_object: Any) -> bool:
        uid = b_object.original.session_uid
        if self._shown is None:
            self._shown = {b_seen.original.session_uid for b_seen in self._depsgraph.objects}
        if uid in self._shown or self._is_only_hidden(b_object.original):
            return True
        if self._instanced is None:  # asked last, for there may be a million
            instances = self._depsgraph.object_instances
            self._instanced = {b_seen.object.original.session_uid for b_seen in instances if b_seen.is_instance}
        return uid in self._instanced

    def _is_only_hidden(self, b_original: Any) -> bool:
        """What the eye icon hides in a viewport is evaluated all the same."""
        if self._depsgraph.mode != "VIEWPORT" or b_original.hide_viewport:
            return False
        return bool(b_original.hide_get(view_layer=self._depsgraph.view_layer))


def _is_placed_by_blender(b_original: Any) -> bool:
    """Whether more than transforms decide where the object is."""
    return bool(b_original.constraints) or b_original.parent_type not in WHOLE_PARENTS
