# SPDX-License-Identifier: GPL-3.0-or-later
"""A capture that stays in its file as a cloud that can be edited: attributes are unpacked when an operation asks."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import warp as wp

from ..buffers import allocate
from ..capture_file import CaptureFile
from ..capture_order import order_of
from ..device import launch
from ..device_cloud import DeviceCloud, empty_cloud
from ..errors import StippleError
from ..progress import Progress
from . import paint_layer, transform_kernels
from . import rows as rows_module
from . import unpack as unpacking
from .capture_edits import VALUES, CaptureEdits, Rows, check_edits_of, identity_of
from .editable_cloud import ELEMENTS, UNPAINTED, EditableCloud
from .edited_values import put_values
from .mask import EDIT_LESS, Mask
from .paint_layer import OpacityDiff, PaintDiff
from .rows import copy_rows, no_rows
from .step import FlagDiff, Step
from .transform_diff import KeptDiff, TransformDiff
from .unpack import unpack

wp.set_module_options({"enable_backward": False})

GEOMETRY = ("position", "scale", "rotation")


@wp.kernel
def find_sources_kernel(
    first: wp.int32, place_from_source: wp.array(dtype=wp.int32), source_from_place: wp.array(dtype=wp.int32)
) -> None:
    i = first + wp.tid()
    source_from_place[place_from_source[i]] = i


def load_kernels(device: wp.Device, progress: Progress) -> None:
    """What unpacks, moves and paints: renders, whose kernels hosts load before, need it only of captures with edits."""
    modules = (unpacking, rows_module, transform_kernels, paint_layer)
    for index, module in enumerate(modules):
        progress(index / len(modules), f"preparing kernels {index + 1}/{len(modules)}, slow only the first time")
        wp.load_module(module, device=device)


class CaptureCloud(EditableCloud):
    """The splats of a capture in the order of its file, unpacked from the quantised arrays on the device.

    `edits` are what it shows; operations change the arrays as those of any cloud, and `edits_after` tells what a step
    has made of them. An attribute is there once it was asked for: a selection by position takes 16 bytes per splat, and
    a stroke of paint some 40. Harmonics are never unpacked, as of a cloud of degree 0, for no operation looks at them:
    paint words and matrices say what becomes of them. With `rows`, which rise, it has only these splats, and their
    harmonics, too.

    Raises StippleError where the edits are of another capture, the file cannot be read, or memory runs out.
    """

    def __init__(
        self,
        capture: CaptureFile,
        device: wp.Device,
        edits: CaptureEdits | None,
        progress: Progress,
        rows: Rows | None = None,
    ) -> None:
        self._packed = capture.upload(device, progress)
        self._order = order_of(capture, device, progress)
        if edits is None:
            edits = CaptureEdits(identity_of(capture.fingerprint), self._order.size)
        check_edits_of(capture.path, capture.fingerprint, edits)
        if edits.splat_count != self._order.size:
            raise StippleError(f"{capture.path}: the edits are of {edits.splat_count:,} splats; discard them.")
        self._begin(self._order.size if rows is None else rows.size, device, capture.name)
        self._chosen = rows
        self._rows = no_rows(device) if rows is None else wp.array(rows, dtype=wp.int32, device=device)
        self.edits = edits
        self.show(edits)

    def show(self, edits: CaptureEdits) -> None:
        """Takes other edits of the same capture up: flags at once, values when they are asked for."""
        self.forget(*ELEMENTS, *UNPAINTED)
        self.edits = edits
        if self._chosen is None:
            self.state.assign(edits.states())
            self._put("sh_rest", wp.empty((self.splat_count, 0), dtype=wp.vec3, device=self.device))
        self.touched(*ELEMENTS)

    def forget(self, *names: str) -> None:
        """Gives back what can be unpacked again."""
        for name in set(names) - {"state"}:
            for held in (self._arrays, self._whole, self._host):
                held.pop(name, None)
            self._owned.discard(name)

    def has(self, name: str) -> bool:
        return super().has(name) or name in self._unpackable()

    def array(self, name: str) -> wp.array:
        missing = name if name not in UNPAINTED or name in self._arrays else UNPAINTED[name]
        if missing not in self._arrays and missing in self._unpackable():
            self._unpack(missing)
        return super().array(name)

    def _unpackable(self) -> tuple[str, ...]:
        return (*GEOMETRY, "opacity", "sh_dc", *(["sh_rest"] if self._chosen is not None else []))

    def _unpack(self, name: str) -> None:
        """An attribute as the edits have it; those that are changed together come together."""
        names: tuple[str, ...] = (name,)
        if name in GEOMETRY and self.edits.get("moved_rows").size:
            names = GEOMETRY
        if name == "sh_rest" or (self._chosen is not None and name in (*GEOMETRY, "sh_dc")):
            names = (*GEOMETRY, "sh_dc", "sh_rest")
        missing = [name for name in names if name not in self._arrays]
        try:
            self._read(missing)
            if set(names) & set(GEOMETRY):
                self._put_values("moved_rows")
            if "sh_dc" in names:
                self._put_values("painted_rows")
            if "opacity" in names:
                self._put_values("opacity_rows")
        except (
            BaseException
        ):  # memory: next time from the start, or what the file has would pass for what the edits say
            layers = [base for base, shown in UNPAINTED.items() if shown in missing]
            self.forget(*missing, *layers, *(["paint"] if "sh_dc" in missing else []))
            raise

    def _read(self, names: list[str]) -> None:
        """As the file has them, but for quantisation."""
        new = {}
        for name in names:
            columns = (self._packed.rest_count,) if name == "sh_rest" else ()
            new[name] = allocate(self.device, ELEMENTS[name], (self.splat_count, *columns), name, EDIT_LESS)
        none = no_rows(self.device)
        if self._chosen is not None:
            places = allocate(self.device, wp.int32, self.splat_count, "the places of splats", EDIT_LESS)
            copy_rows(places.size, self._rows, {"": self._order}, none, {"": places})
            unpack(self._packed, places.size, places, none, new)
        else:
            # Place by place, which reads in order and scatters what it writes: four times as fast on a CPU as the
            # reverse (10 M means in 0.13 core seconds).
            sources = allocate(self.device, wp.int32, self._packed.splat_count, "the order of splats", EDIT_LESS)
            sources.fill_(-1)  # of the empty splats that fill up groups
            launch(find_sources_kernel, self._order.size, [self._order, sources], self.device)
            unpack(self._packed, sources.size, none, sources, new)
        for name, array in new.items():
            self._put(name, array)

    def _put_values(self, name: str) -> None:
        put_values(self, name, *self._local(name), self.edits.matrices)

    def _local(self, name: str) -> tuple[Rows, npt.NDArray[np.generic]]:
        """Numbers in this cloud of the splats that have a value, and the values."""
        if self._chosen is not None:
            return self.edits.values_of(name, self._chosen)
        return self.edits.get(name), self.edits.get(VALUES[name])

    def edits_after(self, step: Step) -> CaptureEdits:
        """The edits once a step, which is applied, is among them. Raises StippleError for one that adds splats."""
        edits = self.edits
        if any(isinstance(diff, FlagDiff) for diff in step.diffs):
            edits = edits.with_states(self.state.numpy())
        for diff in step.diffs:
            if isinstance(diff, TransformDiff | KeptDiff):
                edits = edits.moved(diff.which.indices().numpy(), diff.matrix)
            elif isinstance(diff, PaintDiff):
                edits = self._painted(edits, diff.rows.numpy())
            elif isinstance(diff, OpacityDiff):
                edits = self._opacities(edits, diff.rows.numpy())
            elif not isinstance(diff, FlagDiff):
                raise StippleError(no_new_splats(self.name, step.name))
        return edits

    def keep(self, edits: CaptureEdits) -> None:
        """Takes up what `edits_after` has returned; moved splats are unpacked again, as a reload would."""
        if any(edits.arrays.get(name) is not self.edits.arrays.get(name) for name in ("moved_rows", "matrices")):
            self.forget(*GEOMETRY)
        self.edits = edits

    def edits_meanwhile(self, which: Mask | None = None, matrix: npt.NDArray[np.float64] | None = None) -> CaptureEdits:
        """The edits as the arrays stand in the middle of a stroke, or of a drag of some splats by a map (3, 4)."""
        edits = self.edits.with_states(self.state.numpy())
        if which is not None and matrix is not None:
            return edits.moved(which.indices().numpy(), matrix)
        if "paint" in self._arrays:
            words = self._arrays["paint"].numpy()
            rows = np.union1d(np.flatnonzero(words), edits.get("painted_rows")).astype(np.int32)
            edits = self._painted(edits, rows)
        if "base_opacity" in self._arrays:
            now, base = (self._arrays[name].numpy() for name in ("opacity", "base_opacity"))
            edits = self._opacities(edits, np.flatnonzero(now != base).astype(np.int32))
        return edits

    def _painted(self, edits: CaptureEdits, rows: Rows) -> CaptureEdits:
        words = self.array("paint").numpy()[rows]
        return edits.with_values("painted_rows", rows, words, words == 0)

    def _opacities(self, edits: CaptureEdits, rows: Rows) -> CaptureEdits:
        values = self.array("opacity").numpy()[rows]
        return edits.with_values("opacity_rows", rows, values, values == self.array("base_opacity").numpy()[rows])

    def source_at(self, place: int) -> int:
        """The number in the file of the splat at a place on the device."""
        return int(np.flatnonzero(self._order.numpy() == place)[0])

    def from_places(self, hits: wp.array) -> npt.NDArray[np.uint8]:
        """Bytes per place on the device as bytes per splat of the file, on the host."""
        found: npt.NDArray[np.uint8] = hits.numpy()[self._order.numpy()]
        return found

    def to_device_cloud(self) -> DeviceCloud:
        """Its splats in full precision, without bounds; for clouds of some rows."""
        cloud = empty_cloud(self.splat_count, self._packed.sh_degree)
        for name in (*GEOMETRY, "opacity", "sh_dc"):
            setattr(cloud, name, self.array(name))
        cloud.sh_rest = self.array("sh_rest").flatten()
        return cloud


def no_new_splats(name: str, what: str) -> str:
    """Why an operation that adds splats is refused."""
    return (
        f"{name}: {what} adds splats, which the edits of a linked capture cannot hold; apply the edits to a copy and "
        "import that."
    )
