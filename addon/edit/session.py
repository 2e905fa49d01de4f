# SPDX-License-Identifier: GPL-3.0-or-later
"""What an edit works on: a datablock's splats on the device, read again whenever the datablock is no longer the same.

The datablock is the truth. An operator asks for a session, makes a step of `engine.edit` in it and commits: the arrays
that changed are written back, and Blender's undo sees an ordinary change of attributes. After Blender's undo or redo,
or when something else has tagged the datablock, the next operator compares checksums. Where they are those after one of
the session's own steps, it goes there in its history, and so keeps what the datablock does not know: what paint covers.
Of a linked capture the datablock has a token of the edits (`linked_session`), which is compared each time.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import bpy
import numpy as np
import numpy.typing as npt
from bpy.app.handlers import persistent

from ...engine.errors import StippleError
from ...engine.look import Look
from ...engine.progress import Progress
from ...engine.scene import Instance, SplatStates
from ...engine.splats import ARRAY_NAMES, SplatCloud
from .. import residency
from ..content_keys import attributes_of, key_after, key_of
from ..evaluated_copy import evaluated_copy
from ..kept_for_file import kept_for_file
from ..linked_capture import is_linked
from ..point_rows import Columns, Rows, check_points_only, points_own, replace_points
from ..sequence import plays
from ..splat_data import (
    cloud_from_datablock,
    is_capture,
    splat_count_of,
    states_of,
    write_arrays,
    write_states,
)
from .editing_device import editing_device
from .preview import Preview
from .session_history import SessionHistory
from .solid import show_points

if TYPE_CHECKING:
    import warp as wp

    from ...engine.camera import Camera
    from ...engine.edit.editable_cloud import EditableCloud
    from ...engine.edit.mask import Mask
    from ...engine.edit.step import Step
    from ...engine.picking import Pick
    from ...engine.renderer import Renderer

MOST_SESSIONS = 2  # each holds a capture once more
_sessions: dict[int, EditSession] = {}  # by session_uid of the datablock, the one used last at the end


class EditSession:
    """A datablock's splats as an `EditableCloud`, and the contents of the datablock that they stand for."""

    in_doubt = False  # whether something else than the session may have changed the datablock

    def __init__(self, b_data: Any, name: str, device: wp.Device) -> None:
        from ...engine.edit.editable_cloud import EditableCloud

        b_copy = evaluated_copy(b_data)
        cloud, dropped = cloud_from_datablock(b_copy, name)
        if cloud is None or dropped:
            raise StippleError(f"{name}: {dropped:,} splats have invalid values; use Clean Up > Delete Invalid first.")
        self.name, self._key = name, key_of(b_copy, name)
        self.cloud: EditableCloud = EditableCloud.from_cloud(cloud, device)
        self._put_states(states_of(b_data))
        self._written = dict(self.cloud.versions)
        self._snapshot: tuple[dict[str, int], SplatCloud] = (dict(self.cloud.versions), cloud)
        self._history = SessionHistory(self.cloud, self._key)

    def is_of(self, b_data: Any) -> bool:
        """Whether the datablock holds these splats, or those of a step of this session; takes its flags over.

        Arrays are compared only where there is doubt.
        """
        if self.in_doubt:
            key = key_of(evaluated_copy(b_data), self.name)
            if key != self._key and not self._history.go_to(key):
                return False
            self._key, self._written, self.in_doubt = key, dict(self.cloud.versions), False
        if self.cloud.splat_count != splat_count_of(b_data):
            return False
        states = states_of(b_data)
        if not np.array_equal(self.states(), np.zeros(1, np.uint32) if states is None else states):
            self._put_states(states)
        return True

    def states(self) -> np.ndarray:
        """The flags (N,) uint32; on a CPU a view, valid until the next edit."""
        return self.cloud.state.numpy()

    def commit(
        self, b_data: Any, step: Step, sources: Rows | None = None, done: bool = False, added: Columns | None = None
    ) -> bool:
        """Does a step, unless it is `done`, and writes what it changed; False where it changes nothing.

        `sources`: for steps that append splats, which splat each of them takes its other attributes from; negative for
        the next row of `added`. When anything fails, cloud and datablock are as before and the error goes on.
        """
        if step.changed == 0:
            return False
        attributes = {b_attribute.name for b_attribute in points_own(b_data)}
        try:
            if sources is not None:
                check_points_only(b_data, self.name)
            if not done:
                step.apply(self.cloud)
                done = True
            if self._write(b_data, sources, added):
                self._history.record(step, self._key)
        except BaseException:
            if done:
                step.revert(self.cloud)
                self._write_back(b_data, attributes)
            raise
        bpy.context.view_layer.update()  # now: a tag that comes later is not this session's
        self.in_doubt = False
        return True

    def _write(self, b_data: Any, sources: Rows | None, added: Columns | None) -> bool:
        """Writes the arrays that changed; whether there are some beside the flags."""
        cloud, now = self.snapshot(), self.cloud.versions
        changed = {name for name in now if now[name] != self._written[name]}
        if sources is not None:
            before = np.arange(splat_count_of(b_data))
            rows = np.concatenate([before, sources])
            replace_points(b_data, rows, self.name, attributes_of(changed, self.cloud.rest_count), added)
        write_arrays(b_data, cloud, changed)
        if "state" in changed:
            write_states(b_data, self.states())
        if changed & {"state", "scale", "opacity"}:
            show_points(b_data, True, cloud)
        self._written = dict(now)
        if not changed - {"state"}:
            return False
        self._key = key_after(self._key, b_data, self.name, changed)
        residency.clouds.know(self._key, cloud)
        return True

    def _write_back(self, b_data: Any, attributes: set[str]) -> None:
        """After a failed writing, once the step is reverted; `attributes` are those that points had before."""
        for attribute in {b_attribute.name for b_attribute in points_own(b_data)} - attributes:
            b_data.attributes.remove(b_data.attributes[attribute])
        count = self.cloud.splat_count
        if splat_count_of(b_data) != count:
            replace_points(b_data, np.arange(count), self.name)
        if self.cloud.versions != self._written:
            write_arrays(b_data, self.snapshot(), ARRAY_NAMES)
            write_states(b_data, self.states())
            show_points(b_data, True)
        self._written = dict(self.cloud.versions)

    def snapshot(self) -> SplatCloud:
        """The splats as they are now, flags apart, safe from later edits; what did not change is shared."""
        before, old = self._snapshot
        now = self.cloud.versions
        if self.cloud.splat_count != old.splat_count:
            before = dict.fromkeys(before, -1)
        values = {
            name: getattr(old, name) if before[name] == now[name] else self.cloud.host(name).copy()
            for name in ARRAY_NAMES
        }
        if any(values[name] is not getattr(old, name) for name in ARRAY_NAMES):
            self._snapshot = (dict(now), SplatCloud(**values, name=self.name))
        return self._snapshot[1]

    def check_new_splats(self, what: str) -> None:
        """Raises StippleError where splats cannot be added; asked before anything is done."""

    def separate(self, name: str, progress: Progress) -> tuple[SplatCloud, Step]:
        """The selection as a cloud of its own, and the step that takes it away here. Raises StippleError."""
        from ...engine.edit.duplicate import separate

        return separate(self.cloud, name)

    def preview(self, new_from_old: npt.ArrayLike | None, world_from_object: npt.ArrayLike | None) -> Any:
        """What viewports show of it before anything is written."""
        return Preview(self.snapshot(), SplatStates(self.states().copy()))

    def instances(self, world_from_object: npt.NDArray[np.float64], look: Look) -> tuple[Instance, ...]:
        """What is seen of the edited splats alone."""
        states = SplatStates(self.states().copy())
        return (Instance(self.snapshot(), world_from_object, look=look, states=states),)

    def splat_of(self, found: Pick) -> int:
        """The splat that was found in a picture of `instances`."""
        return found.splat

    def visible(
        self, camera: Camera, renderer: Renderer, world_from_object: npt.NDArray[np.float64], look: Look
    ) -> Mask:
        """The splats of which the camera sees something."""
        from ...engine.edit.match_visible import match_visible

        return match_visible(self.cloud, camera, renderer, world_from_object, look=look)

    def _put_states(self, states: np.ndarray | None) -> None:
        if states is None:
            self.cloud.state.zero_()
        else:
            self.cloud.state.assign(states)


def session_of(b_object: Any, device: str, progress: Progress, by_hand: bool = False) -> EditSession:
    """The session of an object's capture, in step with its datablock. Imports Warp; the first one compiles kernels.

    `by_hand`: what has changed the datablock since the last edit has tagged it, as all that users do does. Scripts may
    write attributes and tag nothing: for them every array is compared.

    Raises StippleError for what is no capture, cannot be changed, or does not fit in memory.
    """
    check_editable(b_object)
    b_data = b_object.data
    session = _sessions.pop(b_data.session_uid, None)
    if session is not None:
        session.name = session.cloud.name = b_object.name  # which may have another one now
        session.in_doubt |= not by_hand
    if session is None or not session.is_of(b_data):
        session = None  # before the new one is made: one of them is large enough
        chosen = editing_device(device, progress)
        if is_linked(b_data):
            from .linked_session import LinkedSession  # imports Warp

            session = LinkedSession(b_data, b_object.name, chosen, progress)
        else:
            session = EditSession(b_data, b_object.name, chosen)
    _sessions[b_data.session_uid] = session
    while len(_sessions) > MOST_SESSIONS:
        _sessions.pop(next(iter(_sessions)))
    return session


def check_editable(b_object: Any) -> None:
    """Raises StippleError, naming the object, for what is no capture or cannot be changed."""
    if b_object is None or not is_capture(b_object.data):
        name = "Edit Splats" if b_object is None else b_object.name
        raise StippleError(f"{name}: this is no capture; make an imported capture the active object.")
    if plays(b_object):
        raise StippleError(f"{b_object.name}: it plays a sequence of files; turn the sequence off to edit its splats.")
    if not b_object.data.is_editable:
        raise StippleError(f"{b_object.name}: its data is linked from another file; make it local first.")


def drop(b_data: Any) -> None:
    """Forgets what is held of a datablock; the next session reads it again."""
    _sessions.pop(b_data.session_uid, None)


def free() -> None:
    _sessions.clear()


@persistent
def _doubt_all(*_: object) -> None:
    """After Blender's undo and redo."""
    for session in _sessions.values():
        session.in_doubt = True


@persistent
def _doubt_changed(_b_scene: Any, depsgraph: Any = None) -> None:
    """After each update of a depsgraph: datablocks that have got new geometry."""
    if _sessions and depsgraph is not None:
        for b_update in depsgraph.updates:
            if b_update.is_updated_geometry and (session := _sessions.get(b_update.id.original.session_uid)):
                session.in_doubt = True


_keep, _let_go = kept_for_file(free)
HANDLERS = (("undo_post", _doubt_all), ("redo_post", _doubt_all), ("depsgraph_update_post", _doubt_changed))


def register() -> None:
    _keep()
    for name, handler in HANDLERS:
        getattr(bpy.app.handlers, name).append(handler)


def unregister() -> None:
    for name, handler in HANDLERS:
        getattr(bpy.app.handlers, name).remove(handler)
    _let_go()
