# SPDX-License-Identifier: GPL-3.0-or-later
"""Objects that play a sequence of splat files: `object.stipple_sequence`, and the cloud one shows at a frame.

The object's datablock keeps the splats of one file, for Solid shading and for selecting it; frames live in
`residency.sequences`. Modifiers see the datablock's splats and do not change those of the frames.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import bpy
from bpy.props import BoolProperty, EnumProperty, FloatProperty, IntProperty, PointerProperty, StringProperty

from ..engine.formats import LoadedSplats, read_splats
from ..engine.formats.sequence import NumberedFiles, Playback, find_numbered
from ..engine.splats import SplatCloud
from .sequence_cache import SequenceClouds
from .sequence_paths import note_folder, path_of

AHEAD = 2  # files that are read before they are needed, per object
FRAMES_AHEAD = 24  # among which they are looked for
LOOPS = (
    ("CLIP", "Clip", "Show nothing before the first and after the last file"),
    ("EXTEND", "Extend", "Hold the first and the last file, as Blender's image sequences do"),
    ("REPEAT", "Repeat", "Start again after the last file"),
    ("PING_PONG", "Ping-Pong", "Play forward and backward in turn"),
)
Entry = tuple[SplatCloud | None, int]


def _changed(b_sequence: Any, _context: Any) -> None:
    b_sequence.id_data.update_tag()


def _path_changed(b_sequence: Any, b_context: Any) -> None:
    note_folder(b_sequence.id_data)
    _changed(b_sequence, b_context)


def _options(**values: Any) -> dict[str, Any]:
    return {"override": {"LIBRARY_OVERRIDABLE"}, "update": _changed, **values}


class StippleSequence(bpy.types.PropertyGroup):
    """Which files an object plays, and when; everything but the file can be animated."""

    enabled: BoolProperty(  # type: ignore[valid-type]
        **_options(
            name="Play Sequence",
            description="Show a file for each frame instead of the splats of the object's data",
            default=False,
        )
    )
    filepath: StringProperty(  # type: ignore[valid-type]
        **_options(
            name="File",
            description="One of the numbered files; those beside it that differ by the number only belong to the "
            "sequence",
            subtype="FILE_PATH",
            options={"PATH_SUPPORTS_BLEND_RELATIVE"},
            update=_path_changed,
        )
    )
    relative_to: StringProperty(  # type: ignore[valid-type]  # see `sequence_paths`
        options={"HIDDEN"}, override={"LIBRARY_OVERRIDABLE"}
    )
    frame_start: IntProperty(  # type: ignore[valid-type]
        **_options(
            name="Start Frame",
            description="Frame that shows the first file, or the last one when playing backward",
            default=1,
        )
    )
    speed: FloatProperty(  # type: ignore[valid-type]
        **_options(
            name="Speed",
            description="Files per frame; below 1 files stay for several frames, a negative speed plays backward",
            default=1.0,
            soft_min=-10.0,
            soft_max=10.0,
        )
    )
    frame_offset: IntProperty(  # type: ignore[valid-type]
        **_options(
            name="Offset",
            description="Files to skip; animate it with a speed of 0 to choose the file for each frame",
            default=0,
        )
    )
    loop: EnumProperty(  # type: ignore[valid-type]
        **_options(
            name="Outside Range",
            description="What to show before the first and after the last file",
            items=LOOPS,
            default="EXTEND",
        )
    )


class SequencePlayer:
    """What objects with a sequence show at the frame of one depsgraph; remembers it for as long as a file is late.

    - `patience`: seconds to wait for a file, None for as long as it takes; `arrived` is called, from another thread,
      when one is there that was waited for in vain.
    """

    def __init__(
        self, clouds: SequenceClouds, patience: float | None = None, arrived: Callable[[], None] | None = None
    ) -> None:
        self._clouds, self._patience, self._arrived = clouds, patience, arrived
        self._b_scene: Any = None
        self._frame: float | None = None  # of the last reading, where it had a sequence
        self._late = threading.Event()
        self._shown: dict[int, Entry] = {}  # by the object's session_uid
        self._before: dict[int, Entry] = {}
        self._warnings: dict[str, None] = {}

    @property
    def warnings(self) -> tuple[str, ...]:
        return tuple(self._warnings)

    def is_stale(self, b_scene: Any) -> bool:
        """Whether another reading would show something else, though Blender says nothing of a change."""
        return self._frame is not None and (self._late.is_set() or self._frame != b_scene.frame_current_final)

    @contextmanager
    def reading(self, b_scene: Any, keep: int = 1) -> Iterator[None]:
        """Brackets the reading of one depsgraph, whose scene this is."""
        self._b_scene, self._frame = b_scene, None
        self._late.clear()
        self._warnings.clear()
        self._before, self._shown = self._shown, {}
        limit = b_scene.stipple.sequence_memory << 20
        with self._clouds.reading(limit, keep, hoard=self._patience is not None or not bpy.app.background):
            yield

    def cloud_of(self, b_object: Any) -> Entry:
        """The cloud of an evaluated object that plays a sequence (None for nothing) and the splats left out."""
        uid = b_object.original.session_uid
        self._frame = self._b_scene.frame_current_final
        if uid not in self._shown:
            self._shown[uid] = self._read(b_object, self._before.get(uid, (None, 0)))
        return self._shown[uid]

    def _read(self, b_object: Any, before: Entry) -> Entry:
        path = path_of(b_object)
        files, play = self._clouds.files_of(path), playback_of(b_object)
        place = play.place(self._b_scene.frame_current_final, files.length)
        entry: Entry = (None, 0)
        if place is not None:
            number, shown = files.at(place)
            wanted = files.numbers[0] + place
            if number != wanted:
                self._warnings[
                    f"{b_object.name}: number {wanted} of the sequence is missing; {shown.name} is held."
                ] = None
            loaded = self._clouds.cloud_of(shown, self._patience, self._on_arrival)
            if loaded is None:
                self._warnings[f"{b_object.name}: reading {shown.name}"] = None
            entry = before if loaded is None else (loaded.cloud, loaded.dropped)
        self._expect(files, play)
        return entry

    def _expect(self, files: NumberedFiles, play: Playback) -> None:
        """Asks for the next files in the order of the frames."""
        frame, step = self._b_scene.frame_current_final, self._b_scene.frame_step if bpy.app.background else 1
        places = (play.place(frame + ahead * step, files.length) for ahead in range(FRAMES_AHEAD + 1))
        paths = dict.fromkeys(files.at(place)[1] for place in places if place is not None)
        for path in list(paths)[1 : 1 + AHEAD]:  # the first is shown
            self._clouds.expect(path)

    def _on_arrival(self) -> None:
        self._late.set()
        if self._arrived is not None:
            self._arrived()


def plays(b_object: Any) -> bool:
    """Whether an object shows a sequence instead of its datablock."""
    return bool(b_object.stipple_sequence.enabled)


def splats_at(b_object: Any, frame: float) -> LoadedSplats | None:
    """What the file holds that an object with a sequence shows at a frame, read for this; None where it shows nothing.

    Raises StippleError where there is no sequence or the file cannot be read.
    """
    files = find_numbered(path_of(b_object))
    place = playback_of(b_object).place(frame, files.length)
    return None if place is None else read_splats(files.at(place)[1])


def playback_of(b_object: Any) -> Playback:
    b_sequence = b_object.stipple_sequence
    return Playback(
        start=b_sequence.frame_start,
        speed=b_sequence.speed,
        offset=b_sequence.frame_offset,
        loop=b_sequence.loop.lower(),
    )


def register() -> None:
    bpy.utils.register_class(StippleSequence)
    bpy.types.Object.stipple_sequence = PointerProperty(type=StippleSequence, override={"LIBRARY_OVERRIDABLE"})


def unregister() -> None:
    del bpy.types.Object.stipple_sequence
    bpy.utils.unregister_class(StippleSequence)
