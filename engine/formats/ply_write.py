# SPDX-License-Identifier: GPL-3.0-or-later
"""Writing captures as PLY files in INRIA's 3DGS layout, which every splat viewer reads."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path

import numpy as np
import numpy.typing as npt

from ..errors import StippleError
from ..splats import SH_REST_COUNT, FloatArray, SplatChunk, SplatCloud
from .atomic_file import Place, replacing
from .ply_layout import file_order, properties_of_arrays
from .splat_format import AnyPath

BLOCK_ROWS = 1 << 13
# sigmoid(±20) is 2.1e-9 and, in float32, exactly 1: opacities 0 and 1 stay finite in the file, and other readers
# can compute exp(20) in any precision.
OPACITY_LOGIT_MAX = 20.0
# A scale of 0 is written as the logarithm of the smallest normal float32, -87.3.
SCALE_MIN = float(np.finfo(np.float32).tiny)


def write_ply(
    path: AnyPath,
    chunks: Iterable[SplatCloud | SplatChunk],
    splat_count: int,
    sh_degree: int,
    place: Place = replacing,
) -> None:
    """Writes chunks of splats as binary little-endian float32 with the properties of INRIA's trainer, normals zero.

    Scales become logarithms, at least log(1.2e-38); opacities become logits within ±20, so that reading them again
    differs by less than 1e-6; SH coefficients and rotations are written as they are. Values are not checked: a cloud
    from a reader has only finite ones. The file is replaced as `place` does it; peak memory is a few MiB besides the
    chunks.

    Raises StippleError where the file cannot be written or the chunks hold another number of splats, and lets through
    what the chunks raise; nothing is replaced then.
    """
    order = file_order(SH_REST_COUNT[sh_degree])
    columns = {
        name: np.array([order.index(column) for column in properties], np.intp)
        for name, properties in properties_of_arrays(SH_REST_COUNT[sh_degree]).items()
    }
    header = ["ply", "format binary_little_endian 1.0", f"element vertex {splat_count}"]
    header += [f"property float {name}" for name in order] + ["end_header", ""]
    with place(Path(path)) as file:
        file.write("\n".join(header).encode("ascii"))
        written = 0
        for chunk in chunks:
            for first in range(0, chunk.splat_count, BLOCK_ROWS):
                block = slice(first, min(first + BLOCK_ROWS, chunk.splat_count))
                file.write(_rows(chunk, block, columns, len(order)).data)
            written += chunk.splat_count
        if written != splat_count:
            raise StippleError(f"{path}: {written:,} splats came where {splat_count:,} were announced; try again.")


def _rows(
    chunk: SplatCloud | SplatChunk, block: slice, columns: Mapping[str, npt.NDArray[np.intp]], width: int
) -> npt.NDArray[np.float32]:
    rows = np.zeros((block.stop - block.start, width), "<f4")
    for name in ("position", "rotation", "sh_dc", "sh_rest"):
        rows[:, columns[name]] = getattr(chunk, name)[block].reshape(len(rows), -1)
    rows[:, columns["scale"]] = np.log(np.maximum(chunk.scale[block], SCALE_MIN))
    rows[:, columns["opacity"]] = _logit(chunk.opacity[block])[:, None]
    return rows


def _logit(opacity: FloatArray) -> FloatArray:
    exact = opacity.astype(np.float64)  # 1 - opacity loses its digits in float32
    with np.errstate(all="ignore"):
        logit = np.log(exact) - np.log1p(-exact)
    clipped: FloatArray = np.clip(logit, -OPACITY_LOGIT_MAX, OPACITY_LOGIT_MAX).astype(np.float32)
    return clipped
