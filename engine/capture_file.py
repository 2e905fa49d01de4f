# SPDX-License-Identifier: GPL-3.0-or-later
"""A capture that stays in its file: what a scene can hold in place of a `SplatCloud` that is too large for it."""

from __future__ import annotations

import os
import weakref
from collections.abc import MutableMapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from .cache_places import CachePlaces, places_from_environment
from .capture_fingerprint import Fingerprint, fingerprint_of, has_changed
from .errors import StippleError
from .formats import open_splats
from .formats.splat_format import AnyPath
from .formats.splat_source import Dropped, SplatSource
from .progress import Progress
from .splats import ARRAY_NAMES, Bounds, FloatArray, SplatCloud, packed_bytes_per_splat

if TYPE_CHECKING:
    import warp as wp

    from .device_cloud import DeviceCloud

LARGE_SPLATS = 10_000_000  # from here on hosts leave a capture in its file unless told otherwise
SAMPLE_SPLATS = 100_000


@dataclass(frozen=True)
class Survey:
    """What one reading of a capture has found.

    - `splat_count`: that can be rendered; `dropped`: of the others.
    - `bounds`: of the means [object units].
    - `sample`: at most 100,000 splats, every `step`-th of those that can be rendered.
    """

    splat_count: int
    dropped: Dropped
    bounds: Bounds
    sample: SplatCloud
    step: int


@dataclass
class Findings:
    """What reading a capture's file has shown so far, and where its splats are by now.

    - `warnings`: sentences about splats that were left out, a damaged cache, a full disk.
    - `device_clouds`: by device, as long as a renderer holds them; `orders`: likewise, see `capture_order`.
    """

    survey: Survey | None = None
    warnings: tuple[str, ...] = ()
    device_clouds: MutableMapping[str, DeviceCloud] = field(default_factory=weakref.WeakValueDictionary)
    orders: MutableMapping[str, wp.array] = field(default_factory=weakref.WeakValueDictionary)


@dataclass(frozen=True, eq=False)
class CaptureFile:
    """A file of splats as it was when it was opened; a `DeviceSource`: the renderer reads it into quantised arrays.

    - `path`: absolute, without `..`.
    - `splat_count`: of the file; those that cannot be rendered are left out when it is read.
    - `fingerprint`: of the file; a file that has another one is another capture.
    - `places`: of its cache file.

    Like a cloud it is equal to itself only and can key a cache. Its properties may read the file, and then raise
    StippleError where it is missing, damaged or has changed.
    """

    path: Path
    splat_count: int
    sh_degree: int
    fingerprint: Fingerprint
    places: CachePlaces
    found: Findings = field(default_factory=Findings, repr=False)

    @classmethod
    def open(cls, path: AnyPath, places: CachePlaces | None = None) -> CaptureFile:
        """Reads the header and at most 4 MiB of the rest; `places` are what STIPPLE_CACHE says where not given.

        Raises StippleError for a file that is missing, unknown, not of splats, or too short for its header.
        """
        path = Path(os.path.abspath(path))
        fingerprint = fingerprint_of(path)
        source = open_splats(path)
        places = places_from_environment() if places is None else places
        return cls(path, source.splat_count, source.sh_degree, fingerprint, places)

    @property
    def name(self) -> str:
        return self.path.stem

    @property
    def nbytes(self) -> int:
        """The most it needs on the device while it is read [bytes], less where there is a cache of it."""
        from .capture_upload import bytes_to_upload

        return bytes_to_upload(self)

    @property
    def packed_bytes(self) -> int:
        """What it takes on the device [bytes], but for its groups (a fourth of a byte per splat)."""
        return self.splat_count * packed_bytes_per_splat(self.sh_degree)

    @property
    def bounds(self) -> Bounds:
        """Of the means [object units]; the first time this reads the file."""
        return self.survey().bounds

    @property
    def warnings(self) -> tuple[str, ...]:
        """Sentences about what was found when it was read; there are none before that."""
        return self.found.warnings

    def has_changed(self) -> bool:
        """Whether the file on disk has another size or date by now, or is gone; reads nothing."""
        return has_changed(self.path, self.fingerprint)

    def source(self) -> SplatSource:
        """The file, opened to be read. Raises StippleError where it is not what it was."""
        source = open_splats(self.path)
        if self.has_changed():
            raise StippleError(f"{self.path}: the file has changed since it was opened; load it again.")
        return source

    def survey(self, progress: Progress | None = None) -> Survey:
        """Reads the file once, the first time it is called."""
        if self.found.survey is None:
            self.found.survey = _survey(self.source(), progress)
        return self.found.survey

    def upload(self, device: wp.Device, progress: Progress) -> DeviceCloud:
        """The capture on the device, from its cache where that is good; all who ask for one device share it.

        The host holds no more than a chunk of it. Sets `warnings`. Raises StippleError where the file cannot be read,
        and lets `Cancelled` through.
        """
        from .capture_upload import upload_capture

        return upload_capture(self, device, progress)


def _survey(source: SplatSource, progress: Progress | None) -> Survey:
    dropped = Dropped()
    step = -(-source.splat_count // SAMPLE_SPLATS)
    low, high, count = np.full(3, np.inf), np.full(3, -np.inf), 0
    sampled: list[dict[str, FloatArray]] = []
    for chunk in source.chunks(progress=progress, dropped=dropped):
        if chunk.splat_count:
            low = np.minimum(low, chunk.position.min(axis=0))
            high = np.maximum(high, chunk.position.max(axis=0))
            first = -count % step
            sampled.append({name: getattr(chunk, name)[first::step].copy() for name in ARRAY_NAMES})
            count += chunk.splat_count
    arrays = {name: np.concatenate([part[name] for part in sampled]) for name in ARRAY_NAMES}
    return Survey(count, dropped, (low, high), SplatCloud(**arrays, name=source.name), step)
