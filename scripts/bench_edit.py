# SPDX-License-Identifier: GPL-3.0-or-later
"""Measure editing: the rows of Splatshop's tables 1 and 2 (doi 10.1111/cgf.70214), and selection beside them.

`scripts/bench --edit` runs it. Captures are generated: splats spread over a slab, in random order. A row is the median
of `--repeats` runs after one that warms up, fewer where they take seconds, as wall and core milliseconds. "few"
touches some tens of splats, "brush" is an everyday one, "all" touches every splat. Sizes for which memory does not
suffice are skipped and say so.
"""

from __future__ import annotations

import gc
import statistics
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import warp as wp

from stipple.engine.buffers import gibibytes
from stipple.engine.camera import Camera, look_at
from stipple.engine.device import free_bytes
from stipple.engine.edit.affine import rotation, scaling, translation
from stipple.engine.edit.brush import Brush
from stipple.engine.edit.editable_cloud import EditableCloud
from stipple.engine.edit.flags import delete
from stipple.engine.edit.history import History
from stipple.engine.edit.match_screen import match_circle, match_polygon
from stipple.engine.edit.match_space import match_sphere
from stipple.engine.edit.paint_layer import begin_colour_layer
from stipple.engine.edit.paint_stroke import PaintStroke
from stipple.engine.edit.selection import select, select_all
from stipple.engine.edit.transform import transform
from stipple.engine.splats import SH_REST_COUNT

EDGE = 10.0  # of the slab [units]
MIDDLE = (0.0, 0.0, 0.0)
LONGEST = 8.0  # [s] after which a row is not repeated again
BRUSH = 0.5  # radius of an everyday brush: some thousandth of the slab


@dataclass
class Bench:
    """One capture being measured, and what has been found."""

    cloud: EditableCloud
    history: History
    repeats: int
    rows: dict[str, dict[str, float]] = field(default_factory=dict)

    def row(self, name: str, run: Callable[[], Any], prepare: Callable[[], Any] | None = None) -> None:
        """Time `run`; `prepare` is not counted."""
        wall, core = [], []
        begin_row = time.perf_counter()
        for run_number in range(self.repeats + 1):
            if run_number > 1 and time.perf_counter() - begin_row > LONGEST:
                break
            if prepare is not None:
                prepare()
            begin, begin_core = time.perf_counter(), time.process_time()
            run()
            wp.synchronize_device(self.cloud.device)
            wall.append(1e3 * (time.perf_counter() - begin))
            core.append(1e3 * (time.process_time() - begin_core))
        self.rows[name] = {"ms": statistics.median(wall[1:]), "core_ms": statistics.median(core[1:])}
        print(f"    {name:34} {self.rows[name]['ms']:10.2f} ms {self.rows[name]['core_ms']:10.2f} core ms", flush=True)


def generated(count: int, degree: int, shapes: bool, device: wp.Device) -> EditableCloud:
    """A slab of splats; without `shapes` only what painting and moving need."""
    rng = np.random.default_rng(1)

    def values(*shape: int) -> np.ndarray:
        return rng.random((count, *shape), np.float32)

    arrays = {"position": values(3), "sh_dc": values(3)}
    arrays["position"] -= np.float32(0.5)
    arrays["position"] *= np.array([EDGE, EDGE, 2], np.float32)
    arrays["sh_rest"] = np.empty((count, 0, 3), np.float32)
    if shapes:
        arrays |= {"opacity": values(), "scale": values(3)}
        arrays["scale"] *= np.float32(0.01)
        turned = values(4)
        turned /= np.sqrt(np.einsum("nk,nk->n", turned, turned))[:, None]
        arrays["rotation"] = turned
        arrays["sh_rest"] = values(SH_REST_COUNT[degree], 3)
    return EditableCloud(arrays, device, f"{count / 1e6:g} M splats")


def selection_rows(bench: Bench) -> None:
    cloud, history = bench.cloud, bench.history
    camera = Camera(look_at((0, 0, -12), MIDDLE), 1920, 1080, 1500, 1500, 960, 540, near=0.05)
    bench.row("select: circle, centres", lambda: match_circle(cloud, camera, (960, 540), 60))
    if cloud.has("scale"):
        bench.row("select: circle, borders", lambda: match_circle(cloud, camera, (960, 540), 60, border=True))
    angle = np.linspace(0, 2 * np.pi, 200, endpoint=False)
    lasso = np.column_stack([960 + 300 * np.cos(angle), 540 + 300 * np.sin(3 * angle)])
    bench.row("select: lasso of 200 corners", lambda: match_polygon(cloud, camera, lasso))
    found = match_circle(cloud, camera, (960, 540), 60)
    bench.row("select: step and its undo", lambda: (history.do(select(cloud, found)), history.undo()))
    history.do(select(cloud, found))
    bench.row("delete: step and its undo", lambda: (history.do(delete(cloud)), history.undo()))
    history.go_to(0)


def undo_rows(bench: Bench, name: str, redo_too: bool = False) -> None:
    """Undo, and where asked redo, of the last step; it is undone at the end."""
    history = bench.history
    done = history.position
    bench.rows[name]["step_bytes"] = history.undo_step.nbytes if history.undo_step else 0
    bench.row(f"{name}, undo", history.undo, lambda: history.go_to(done))
    if redo_too:
        bench.row(f"{name}, apply", history.redo, lambda: history.go_to(done - 1))
    history.go_to(done - 1)


def painting_rows(bench: Bench) -> None:
    """Table 1: a dab, compaction (the stroke becomes a step), undo."""
    cloud, history = bench.cloud, bench.history
    begin_colour_layer(cloud)
    strokes: list[PaintStroke] = []

    def begin() -> None:
        if strokes:
            strokes.pop().cancel()
        strokes.append(PaintStroke(cloud, Brush("hue_saturation", (0.9, 0.3, 0.1), strength=0.5)))

    for name, radius in {"few": few_radius(cloud), "brush": BRUSH, "all": 10 * EDGE}.items():

        def dab(harmonics: bool = True, radius: float = radius) -> None:
            strokes[-1].dab(MIDDLE, radius, harmonics)

        bench.row(f"paint {name}: dab", dab, begin)
        if cloud.rest_count:
            bench.row(f"paint {name}: dab, harmonics later", lambda dab=dab: dab(False), begin)

        def painted(dab: Callable[[], None] = dab) -> None:
            begin()
            dab()

        bench.row(f"paint {name}: compaction", lambda: strokes[-1].finish(), painted)  # noqa: PLW0108  another each time
        painted()
        step = strokes.pop().finish()
        assert step is not None
        history.record(step)
        bench.rows[f"paint {name}: compaction"]["splats"] = step.changed
        bench.rows[f"paint {name}"] = {}
        undo_rows(bench, f"paint {name}")


def transform_rows(bench: Bench) -> None:
    """Table 2: the paper's duration is that of applying; its undo applies the inverse, this one restores every bit."""
    cloud, history = bench.cloud, bench.history
    kinds = {"move": translation((0.1, 0.2, 0.3))}
    if cloud.has("scale"):
        kinds |= {"scale": scaling(1.1), "rotate": rotation((1, 2, 3), 0.3)}
    for which in ("few", "all"):
        few = which == "few"
        history.do(select(cloud, match_sphere(cloud, MIDDLE, few_radius(cloud))) if few else select_all(cloud))
        for kind, matrix in kinds.items():
            bench.row(f"{kind} {which}: diff", lambda matrix=matrix: transform(cloud, matrix))
            history.do(transform(cloud, matrix))
            bench.rows[f"{kind} {which}"] = {}
            undo_rows(bench, f"{kind} {which}", redo_too=True)
        history.go_to(0)


def few_radius(cloud: EditableCloud) -> float:
    """Of a ball that holds some 30 splats of the slab."""
    return (30 * EDGE * EDGE * 2 / cloud.splat_count / 4.19) ** (1 / 3)


@dataclass(frozen=True)
class Size:
    """A capture to measure: how many splats, of which degree, with or without shapes."""

    millions: float
    degree: int
    shapes: bool = True

    @property
    def bytes_needed(self) -> int:
        """Most held at once: the arrays, a painted copy of colour and harmonics, a stroke, and what undo works with."""
        own = 4 + 12 + 12 + (32 + 12 * SH_REST_COUNT[self.degree] if self.shapes else 0)
        paint = 8 + 12 + 8 + 2 + 1 + 12 + (12 * SH_REST_COUNT[self.degree])
        return int(self.millions * 1e6 * (own + paint + 24))


# The paper's Berlin, Garden, Campus and G25.
SIZES = (
    Size(1, 3),
    Size(6, 3),
    Size(6, 0),
    Size(28, 3),
    Size(28, 2),
    Size(28, 1),
    Size(28, 0),
    Size(137, 0, shapes=False),
)


def measure_editing(device: wp.Device, repeats: int, largest: float) -> dict[str, Any]:
    """All rows of all sizes up to `largest` [millions] for which memory suffices."""
    results: dict[str, Any] = {}
    for size in SIZES:
        name = f"{size.millions:g} M, SH degree {size.degree}" + ("" if size.shapes else ", means and colours only")
        if size.millions > largest:
            continue
        if size.bytes_needed > free_bytes(device):
            needed, free = gibibytes(size.bytes_needed), gibibytes(free_bytes(device))
            print(f"{name}: skipped, {needed} are needed and {free} are free")
            continue
        print(name, flush=True)
        cloud = generated(int(size.millions * 1e6), size.degree, size.shapes, device)
        bench = Bench(cloud, History(cloud), repeats)
        for rows in (selection_rows, transform_rows, painting_rows):
            rows(bench)
        results[name] = {row: values for row, values in bench.rows.items() if values}
        del bench, cloud
        gc.collect()
    return results
