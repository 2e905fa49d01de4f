# SPDX-License-Identifier: GPL-3.0-or-later
"""A capture on the device that can be edited: its arrays, the state of its splats and what has been painted on it."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Any

import numpy as np
import numpy.typing as npt
import warp as wp

from ..buffers import Buffers, allocate
from ..errors import StippleError
from ..splats import ARRAY_NAMES, SplatCloud, sh_degree_of_rest_count
from .mask import EDIT_LESS, Mask, mask_from_state
from .rows import copy_rows, no_rows
from .state import DELETED, HIDDEN, NOT_SELECTABLE, SELECTED

ELEMENTS = {
    "position": wp.vec3,
    "scale": wp.vec3,
    "rotation": wp.vec4,
    "opacity": wp.float32,
    "sh_dc": wp.vec3,
    "sh_rest": wp.vec3,
    "state": wp.uint32,
    "paint": wp.uint64,
}
MOST_SPLATS = (1 << 31) - 1
# What an attribute is a painted copy of, once anything was painted.
UNPAINTED = {"base_dc": "sh_dc", "base_rest": "sh_rest", "base_opacity": "opacity"}


class EditableCloud:
    """A capture's arrays on one device; operations of this package change them. `array(name)` gives them:

    - `position` (N,) vec3, `scale` vec3, `rotation` vec4 (w, x, y, z), `opacity` float32, `sh_dc` vec3 and `sh_rest`
      (N, C) vec3: as in `SplatCloud`, with everything done so far in them. An attribute that was left out at the start
      is missing, and an operation that needs it says so.
    - `state` (N,) uint32: the flags of `state.py`.
    - `base_dc`, `base_rest`, `base_opacity`: the same without paint; the very arrays above until something is painted.
    - `paint` (N,) uint64: the paint words of `paint_word.py`; missing until something is painted.

    On a CPU the arrays begin as views of the host's and each is copied when it is first written, so that a session that
    only selects holds four bytes per splat. The host's arrays are never written.

    `versions[name]` grows each time an attribute changes: a host uploads what it has not seen.

    Raises StippleError for a missing position, wrong shapes, or too little memory.
    """

    def __init__(self, arrays: Mapping[str, npt.NDArray[np.float32]], device: wp.Device, name: str = "splats") -> None:
        if "position" not in arrays or not set(arrays) <= set(ARRAY_NAMES):
            raise StippleError(f"{name}: editing needs position, and of the rest any of {', '.join(ARRAY_NAMES)}.")
        self._begin(len(arrays["position"]), device, name)
        self._host |= arrays  # what views look at must stay
        for key, values in arrays.items():
            if len(values) != self.splat_count or values.dtype != np.float32 or not values.flags.c_contiguous:
                raise StippleError(f"{name}: {key} must be contiguous float32 with {self.splat_count:,} rows.")
            self._arrays[key] = self._upload(key, values)

    def _begin(self, splat_count: int, device: wp.Device, name: str) -> None:
        """No attributes yet, and no flags."""
        self.name, self.device, self.splat_count = name, device, splat_count
        self.scratch = Buffers(device)
        self.spare: dict[str, wp.array] = {}  # what strokes have given back, by name
        self.versions = dict.fromkeys(ELEMENTS, 0)
        self._host: dict[str, npt.NDArray[np.float32]] = {}
        self._owned: set[str] = set()
        self._arrays: dict[str, wp.array] = {}
        self._whole: dict[str, wp.array] = {}  # arrays longer than the cloud, of which `_arrays` holds views
        state = allocate(device, wp.uint32, splat_count, "the state of the splats", EDIT_LESS)
        state.zero_()
        self._put("state", state)

    @classmethod
    def from_cloud(
        cls, cloud: SplatCloud, device: wp.Device, attributes: Collection[str] = ARRAY_NAMES
    ) -> EditableCloud:
        """Begin editing a capture with only the named attributes; position always comes along."""
        kept = [key for key in ARRAY_NAMES if key in attributes or key == "position"]
        return cls({key: getattr(cloud, key) for key in kept}, device, cloud.name)

    @property
    def state(self) -> wp.array:
        """The flags of each splat (N,) uint32."""
        return self._arrays["state"]

    def array(self, name: str) -> wp.array:
        """The array called `name`, for reading. Raises StippleError where the cloud came without it."""
        if name not in self._arrays and name in UNPAINTED:
            name = UNPAINTED[name]
        if name not in self._arrays:
            raise StippleError(f"{self.name}: this needs each splat's {name}, which was not loaded for editing.")
        return self._arrays[name]

    def has(self, name: str) -> bool:
        """Whether the attribute was loaded (base_… and paint: whether anything was painted)."""
        return name in self._arrays

    @property
    def attribute_names(self) -> tuple[str, ...]:
        """Every array there is, state and layers included."""
        return tuple(self._arrays)

    @property
    def rest_count(self) -> int:
        """Coefficients per channel above band 0; 0 where sh_rest was not loaded."""
        return int(self._arrays["sh_rest"].shape[1]) if "sh_rest" in self._arrays else 0

    @property
    def sh_degree(self) -> int:
        return sh_degree_of_rest_count(self.rest_count)

    @property
    def held_bytes(self) -> int:
        """Device memory of arrays that are the cloud's own, views of the host's left out [bytes]."""
        own = [self._whole.get(name, self._arrays[name]) for name in self._owned]
        return sum(array.capacity for array in (*own, *self.spare.values())) + self.scratch.held_bytes

    def selection(self) -> Mask:
        """What operations act on: selected, and neither hidden, deleted nor locked."""
        return mask_from_state(self.state, SELECTED, NOT_SELECTABLE)

    def selectable(self) -> Mask:
        """Neither hidden, deleted nor locked."""
        return mask_from_state(self.state, 0, NOT_SELECTABLE)

    def shown(self) -> Mask:
        """Neither hidden nor deleted."""
        return mask_from_state(self.state, 0, HIDDEN | DELETED)

    def kept(self) -> Mask:
        """Not deleted."""
        return mask_from_state(self.state, 0, DELETED)

    def writable(self, name: str) -> wp.array:
        """The array called `name`, for writing: a view of the host's is copied first.

        Call it for every array an operation will write before writing to any, so that running out of memory here
        leaves everything as it was. `touched` follows once it was written.
        """
        held = self.array(name)
        if name in UNPAINTED and name not in self._arrays:
            name = UNPAINTED[name]
        if name not in self._owned:
            own = allocate(self.device, held.dtype, held.shape, f"a changeable copy of {name}", EDIT_LESS)
            wp.copy(own, held)
            self._put(name, own)
            self._host.pop(name, None)
        return self._arrays[name]

    def add_layer(self, bases: Collection[str], arrays: Mapping[str, wp.array]) -> None:
        """Separate the named unpainted arrays (keys of `UNPAINTED`) from the painted ones, and take `arrays` up.

        What was the only copy becomes the unpainted one; the painted one is a new copy. All or nothing: raises
        StippleError when memory runs out.
        """
        copies = {}
        for base in bases:
            held = self.array(base)
            copies[base] = allocate(
                self.device, held.dtype, held.shape, f"a painted copy of {UNPAINTED[base]}", EDIT_LESS
            )
            wp.copy(copies[base], held)
        for base, copy in copies.items():
            shown = UNPAINTED[base]
            self._arrays[base] = self._arrays[shown]
            if shown in self._whole:
                self._whole[base] = self._whole.pop(shown)
            if shown in self._owned:
                self._owned.add(base)
            elif shown in self._host:
                self._host[base] = self._host.pop(shown)
            self._put(shown, copy)
        for name, array in arrays.items():
            self._put(name, array)

    def grow(self, count: int, rest_count: int | None = None) -> None:
        """Make room for `count` more splats at the end, uninitialised, and for `rest_count` coefficients per channel.

        New coefficients of old splats are 0. All or nothing: raises StippleError when memory runs out or there would be
        more splats than an index can count.
        """
        total = self.splat_count + count
        if total > MOST_SPLATS:
            raise StippleError(
                f"{self.name}: {total:,} splats are more than {MOST_SPLATS:,}; keep them in two captures."
            )
        self._resize(total, self.rest_count if rest_count is None else rest_count)

    def shrink(self, count: int, rest_count: int | None = None) -> None:
        """Take the last `count` splats, and the highest coefficients, away again. Their memory is kept for new ones."""
        self._resize(self.splat_count - count, self.rest_count if rest_count is None else rest_count)

    def _resize(self, total: int, rest_count: int) -> None:
        """All arrays with `total` rows: views where they reach, else larger ones with what was in them."""
        resized = {}
        for name, held in self._arrays.items():
            shape = (total, rest_count) if held.ndim == 2 else (total,)
            whole = self._whole.get(name, held)
            if 0 in shape:  # harmonics of degree 0: no memory, and Warp cannot slice it
                resized[name] = wp.empty(shape, dtype=held.dtype, device=self.device)
                continue
            if name in self._owned and whole.shape[0] >= total and whole.shape[1:] == shape[1:]:
                resized[name] = whole
                continue
            spare = (total // 8 if total > self.splat_count else 0, *(0 for _ in shape[1:]))
            larger = tuple(size + more for size, more in zip(shape, spare, strict=True))
            resized[name] = allocate(self.device, held.dtype, larger, f"{name} of more splats", EDIT_LESS)
            if held.ndim == 2 and rest_count > held.shape[1]:
                resized[name].zero_()
            kept = min(total, self.splat_count)
            copy_rows(kept, no_rows(self.device), {name: held}, no_rows(self.device), resized)
        for name, array in resized.items():
            self._put(name, array)
            self._whole[name] = array
            self._arrays[name] = array[:total] if array.size else array
            self._host.pop(name, None)
        self.splat_count = total

    def touched(self, *names: str) -> None:
        """Say that attributes have changed; an unpainted one counts as the painted one that follows from it."""
        for name in names:
            self.versions[UNPAINTED.get(name, name)] += 1

    def spare_array(self, name: str, dtype: Any) -> wp.array:
        """An uninitialised element per splat for one stroke alone, which puts it into `spare` when it ends.

        Raises StippleError when memory runs out.
        """
        held = self.spare.pop(name, None)
        if held is not None and held.size == self.splat_count:
            return held
        return allocate(self.device, dtype, self.splat_count, "a paint stroke", EDIT_LESS)

    def hits(self) -> wp.array:
        """Scratch of one uint8 per splat, uninitialised; the next caller overwrites it."""
        return self.scratch.array("hits", wp.uint8, self.splat_count)

    def host(self, name: str) -> npt.NDArray[np.float32]:
        """The array called `name` on the host, in `SplatCloud`'s shape. On a CPU a view, valid until the next edit."""
        return self.array(name).numpy()

    def to_cloud(self, which: Mask | None = None, name: str | None = None) -> SplatCloud:
        """A new SplatCloud of the given splats, else of all that are not deleted; the host's copy, safe from edits.

        Raises StippleError when there are none, or when an attribute was not loaded.
        """
        rows = (which if which is not None else self.kept()).numpy()
        if not rows.any():
            raise StippleError(f"{self.name}: no splats are left; restore some or keep the capture as it was.")
        whole = rows.all()
        values = {key: self.host(key).copy() if whole else self.host(key)[rows] for key in ARRAY_NAMES}
        return SplatCloud(**values, name=name or self.name)

    def _put(self, name: str, array: wp.array) -> None:
        self._arrays[name] = array
        self._whole.pop(name, None)
        self._owned.add(name)

    def _upload(self, name: str, values: npt.NDArray[np.float32]) -> wp.array:
        dtype = ELEMENTS[name]
        shape = values.shape[:2] if name == "sh_rest" else values.shape[:1]
        if values.size == 0:
            return wp.empty(shape, dtype=dtype, device=self.device)
        if self.device.is_cuda:
            array = allocate(self.device, dtype, shape, f"{name} of the splats", EDIT_LESS)
            array.assign(values)
            self._owned.add(name)
            return array
        return wp.array(
            ptr=values.ctypes.data, dtype=dtype, shape=shape, device=self.device, capacity=values.nbytes, copy=False
        )
