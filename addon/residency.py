# SPDX-License-Identifier: GPL-3.0-or-later
"""What stays in memory between frames: clouds by content, and the renderer with what it uploaded.

Blender makes a new RenderEngine for every frame, so this lives at module level. Everything is freed when a file
is loaded and when the add-on is disabled.
"""

from __future__ import annotations

import logging
import sys
from collections.abc import Callable, Collection, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Any
from weakref import WeakValueDictionary

from ..engine.capture_file import CaptureFile
from ..engine.errors import DeviceError, StippleError
from ..engine.splats import SplatCloud
from . import world
from .content_keys import CloudKey, key_of, sample_of
from .kept_for_file import kept_for_file
from .kernel_folder import keep_kernels_in_extension_folder
from .linked_capture import path_of, problem_of
from .object_properties import changed_looks
from .preferences import cache_places
from .sequence_cache import SequenceClouds
from .splat_data import cloud_from_datablock, splat_count_of
from .viewport_worker import ViewportWorker

if TYPE_CHECKING:
    from ..engine.renderer import Renderer

Entry = tuple[SplatCloud | None, int]
Place = tuple[int, int, int]  # address and session_uid of a datablock, its splats


class CloudCache:
    """Clouds keyed by content: the same splats give the same SplatCloud object from frame to frame.

    A renderer that uploads per SplatCloud object then uploads each capture once, whatever Blender copies.
    """

    def __init__(self) -> None:
        self._entries: dict[CloudKey, Entry] = {}
        self._alive: WeakValueDictionary[CloudKey, SplatCloud] = WeakValueDictionary()  # dropped here, in use elsewhere
        self._last_read: dict[CloudKey, int] = {}
        self._read = 0
        self._key_of_address: dict[int, CloudKey] = {}

    def __len__(self) -> int:
        return len(self._entries)

    @contextmanager
    def reading(self, keep: int = 1) -> Iterator[None]:
        """Brackets the reading of one depsgraph; what none of the last `keep` readings asked for is dropped after it.

        A frame reads once for each view layer, so `keep` is their number.
        """
        self._read += 1
        self._key_of_address.clear()
        yield
        kept = {key: read for key, read in self._last_read.items() if read > self._read - keep}
        self._entries = {key: self._entries[key] for key in kept}
        self._last_read = kept
        self._key_of_address.clear()

    def cloud_of(self, b_data: Any, name: str) -> Entry:
        """The cloud of an evaluated datablock (None without usable splats) and the number of splats left out.

        Only inside `reading`: there an address names one datablock, so instances of it are read once.
        """
        address = b_data.as_pointer()
        key = self._key_of_address.get(address)
        if key is None:
            key = self._key_of_address[address] = key_of(b_data, name)
        if key not in self._entries:
            alive = self._alive.get(key)
            self._entries[key] = (alive, 0) if alive is not None else cloud_from_datablock(b_data, name)
            cloud, dropped = self._entries[key]
            if cloud is not None and not dropped:
                self._alive[key] = cloud
        self._last_read[key] = self._read
        return self._entries[key]

    def know(self, key: CloudKey, cloud: SplatCloud) -> None:
        """Take a cloud that someone else holds for the content of a key: it need not be read, or uploaded again."""
        self._alive[key] = cloud

    def free(self) -> None:
        self._entries.clear()
        self._last_read.clear()
        self._key_of_address.clear()


class LinkedCaptures:
    """Linked files by path: the same CaptureFile from frame to frame, as long as the file is the same."""

    def __init__(self) -> None:
        self._captures: dict[Path, CaptureFile] = {}

    def capture_of(self, b_data: Any, name: str) -> CaptureFile:
        """What a linked datablock stands for, as it is on disk now. Raises StippleError where it cannot be read."""
        problem = problem_of(b_data, name)
        path = path_of(b_data)
        if problem or path is None:
            raise StippleError(problem)
        capture = self._captures.get(path)
        if capture is None or capture.has_changed():
            capture = self._captures[path] = CaptureFile.open(path, cache_places())
        return capture

    def free(self) -> None:
        self._captures.clear()


class EvaluatedClouds:
    """The clouds of one viewport, where a depsgraph stays and says what changed: nothing else is read again.

    Blender calls the geometry of an object changed when only its look is. Where a look has changed, a sample of the
    geometry decides: reading a million splats takes a fifth of a second, too long for a slider that is dragged. An
    edit of a few splats in the same moment, by a script, shows with the next change of the geometry.
    """

    def __init__(self, cache: CloudCache) -> None:
        self._cache = cache
        self._known: dict[Place, Entry] = {}
        self._seen: dict[Place, Entry] = {}
        self._changed: Collection[int] = ()
        self._samples: dict[tuple[int, ...], tuple[tuple[float, ...], Entry]] = {}  # by uids and count
        self._looks_until = 0  # the number of the last change of a look that was read
        self._looks: Collection[int] = ()  # session_uids of what has a new look

    @contextmanager
    def reading(self, changed: Collection[int]) -> Iterator[None]:
        """Brackets one reading; `changed` are the session_uids of objects and data whose geometry is new."""
        self._changed, self._seen = changed, {}
        self._looks = {uid for uid, number in changed_looks.items() if number > self._looks_until}
        self._looks_until = max(changed_looks.values(), default=self._looks_until)
        with self._cache.reading():
            yield
        self._known = self._seen
        kept = {id(entry) for entry in self._seen.values()}
        self._samples = {key: held for key, held in self._samples.items() if id(held[1]) in kept}

    def cloud_of(self, b_data: Any, name: str, uids: Collection[int]) -> Entry:
        """As CloudCache.cloud_of; `uids` are those of the original data, object and instancing object."""
        place = self.keep(b_data, uids)
        if place not in self._seen:
            self._seen[place] = self._sampled(b_data, name, (*uids, place[2]))
        return self._seen[place]

    def _sampled(self, b_data: Any, name: str, key: tuple[int, ...]) -> Entry:
        """What is known where only the look is new and the sample is the same, else what is read."""
        sample, held = sample_of(b_data), self._samples.get(key)
        if held is None or held[0] != sample or not any(uid in self._looks for uid in key[:-1]):
            held = self._samples[key] = (sample, self._cache.cloud_of(b_data, name))
        return held[1]

    def keep(self, b_data: Any, uids: Collection[int]) -> Place:
        """Remembers what is known of data that is not shown now but may be again; returns its key."""
        place = (b_data.as_pointer(), b_data.original.session_uid, splat_count_of(b_data))
        if place in self._known and not any(uid in self._changed for uid in uids):
            self._seen.setdefault(place, self._known[place])
        return place


clouds = CloudCache()
sequences = SequenceClouds()
linked = LinkedCaptures()
_renderers: dict[str, Renderer] = {}  # of final renders, by device; at most one
_prepared: set[tuple[str, str]] = set()
_failed: dict[str, str] = {}  # devices, and why
log = logging.getLogger(__package__)


def prepare(
    device: str,
    method: str,
    progress: Callable[[float, str], None],
    turn: Callable[[], AbstractContextManager[None]] = nullcontext,
) -> None:
    """Imports Warp and loads the kernels of a method, which compiles them the very first time; `progress` may raise.

    Only inside `worker.final_render` or in the worker's thread; or with a `turn` that makes `worker.final_render` for
    each module. Raises StippleError for a device that is not there.
    """
    if (device, method) in _prepared:
        return
    progress(0.0, "starting")
    with turn():
        keep_kernels_in_extension_folder()
        from ..engine.device import choose_device
        from ..engine.warm_up import load_kernels

        chosen = choose_device(device)
    load_kernels(chosen, method, progress, turn)
    _prepared.add((device, method))


def is_prepared(device: str, method: str) -> bool:
    """Whether `prepare` would return at once."""
    return (device, method) in _prepared


worker = ViewportWorker(prepare)


def on_a_device(device: str, work: Callable[[str], None], warn: Callable[[str], None]) -> None:
    """Does the work on a device, or all of it on the CPU where the device is full, missing or fails; `warn` says so.

    A device that failed at work is not asked again before `free`: what it holds is lost, and CUDA does not recover
    within a process. A full one is, for memory may have become free. Raises what the work raises on the CPU.
    """
    from ..engine.device import is_cpu

    reason = _failed.get(device, "")
    if not reason:
        try:
            work(device)
            return
        except (DeviceError, RuntimeError) as error:
            if is_cpu(device):
                raise
            if isinstance(error, DeviceError):
                reason = str(error)
            else:
                log.exception("%s failed", device)
                reason = _failed[device] = f"{device} failed ({error}); restart Blender to use it again."
    free_renderer()
    warn(f"{reason} The CPU renders instead.")
    work("cpu")


def renderer_for(device: str) -> Renderer:
    """The renderer of final renders for a device; changing the device frees the one before. Imports Warp."""
    if device not in _renderers:
        free_renderer()
        keep_kernels_in_extension_folder()
        _renderers[device] = raster_renderer(device)
    return _renderers[device]


def raster_renderer(device: str) -> Renderer:
    """A new renderer whose *rays* are drawn by Blender's gpu module. Imports Warp."""
    from ..engine.renderer import Renderer
    from .raster_device import BlenderRasterDevice

    return Renderer(device, raster_host=BlenderRasterDevice)


def free_renderer() -> None:
    """Gives back the device memory of final renders; the next one uploads again."""
    while _renderers:
        _renderers.popitem()[1].free()


def free() -> None:
    """Drops every viewport, cloud and renderer and ends all threads."""
    worker.stop()
    free_renderer()
    clouds.free()
    sequences.free()
    world.images.free()
    _failed.clear()
    linked.free()
    device = sys.modules.get(f"{str(__package__).rpartition('.')[0]}.engine.device")
    if device is not None:  # else Warp was never imported; not only renders launch, editing does, too
        device.close_pools()


register, unregister = kept_for_file(free)
