# SPDX-License-Identifier: GPL-3.0-or-later
"""What an edit of a linked capture works on: its quantised splats, and the edits that the datablock's token names."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from ...engine.edit.capture_cloud import CaptureCloud, no_new_splats
from ...engine.edit.capture_edits import CaptureEdits, identity_of
from ...engine.edit.edited_capture import EditedCapture
from ...engine.edit.state_bits import DELETED, HIDDEN
from ...engine.errors import StippleError
from ...engine.look import Look
from ...engine.scene import Instance
from ...engine.splats import SplatCloud
from .. import linked_edits
from ..point_rows import Columns, Rows
from ..residency import linked, worker
from .preview import LinkedPreview
from .session import EditSession
from .solid import show_points

if TYPE_CHECKING:
    import warp as wp

    from ...engine.camera import Camera
    from ...engine.edit.mask import Mask
    from ...engine.edit.step import Step
    from ...engine.picking import Pick
    from ...engine.renderer import Renderer


class LinkedSession(EditSession):
    """The splats of a linked capture's file as a `CaptureCloud`; the datablock's proxy plays no part."""

    cloud: CaptureCloud

    def __init__(self, b_data: Any, name: str, device: wp.Device, progress: Callable[[float, str], None]) -> None:
        self.name = name
        self._capture = linked.capture_of(b_data, name)
        found = linked_edits.found_edits(b_data, name)
        with worker.final_render(lambda: None):  # or a viewport would read the file beside it
            self.cloud = CaptureCloud(self._capture, device, found.edits if found else None, progress)
        self.cloud.name = name  # which users know; the file has another

    def is_of(self, b_data: Any) -> bool:
        """Whether the file is the same; edits that differ are taken over."""
        if linked.capture_of(b_data, self.name) is not self._capture:
            return False
        found = linked_edits.found_edits(b_data, self.name)
        edits = found.edits if found else CaptureEdits(identity_of(self._capture.fingerprint), self.cloud.splat_count)
        if edits.token != self.cloud.edits.token:
            self.cloud.show(edits)
        return True

    def commit(
        self, b_data: Any, step: Step, sources: Rows | None = None, done: bool = False, added: Columns | None = None
    ) -> bool:
        """See `EditSession.commit`; what is written is the edits' token. Refuses steps that append splats."""
        if step.changed == 0:
            return False
        try:
            if sources is not None:
                self.check_new_splats(step.name)
            if not done:
                step.apply(self.cloud)
                done = True
            edits = self.cloud.edits_after(step)
            linked_edits.put_edits(b_data, edits)
            show_points(b_data, True)
        except BaseException:
            if done:
                step.revert(self.cloud)
            raise
        self.cloud.keep(edits)
        return True

    def check_new_splats(self, what: str) -> None:
        raise StippleError(no_new_splats(self.name, what))

    def separate(self, name: str, progress: Callable[[float, str], None]) -> tuple[SplatCloud, Step]:
        """See `EditSession.separate`; the cloud has the file's own values, which are read for it."""
        from ...engine.edit.duplicate import separate_step
        from ...engine.edit.edited_copy import read_selection

        step = separate_step(self.cloud)
        return read_selection(self._capture, self.cloud.edits, name, progress), step

    def _edited(self, edits: CaptureEdits) -> EditedCapture:
        return linked_edits.edited_capture(self._capture, edits)

    def preview(self, new_from_old: npt.ArrayLike | None, world_from_object: npt.ArrayLike | None) -> LinkedPreview:
        if new_from_old is None:
            return LinkedPreview(self._edited(self.cloud.edits_meanwhile()))
        from ...engine.edit.affine import checked, in_object_space

        matrix = in_object_space(checked(new_from_old, f"{self.name}: the transform"), world_from_object)
        return LinkedPreview(self._edited(self.cloud.edits_meanwhile(self.cloud.selection(), matrix)))

    def instances(self, world_from_object: npt.NDArray[np.float64], look: Look) -> tuple[Instance, ...]:
        instance = Instance(self._capture, world_from_object, look=look)
        return self._edited(self.cloud.edits).instances(instance, HIDDEN | DELETED)

    def splat_of(self, found: Pick) -> int:
        if found.instance == 1:
            return int(self.cloud.edits.changed_rows[found.splat])
        return self.cloud.source_at(found.splat)

    def visible(
        self, camera: Camera, renderer: Renderer, world_from_object: npt.NDArray[np.float64], look: Look
    ) -> Mask:
        from ...engine.edit.match_visible import match_visible_in_file

        return match_visible_in_file(self.cloud, self.instances(world_from_object, look), camera, renderer)
