# SPDX-License-Identifier: GPL-3.0-or-later
"""Writing captures as PLY files in INRIA's 3DGS layout, which every splat viewer reads."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ..splats import FloatArray, SplatCloud
from .atomic_file import replacing
from .ply_layout import file_order, properties_of_arrays
from .splat_format import AnyPath

BLOCK_ROWS = 1 << 13
# sigmoid(±20) is 2.1e-9 and, in float32, exactly 1: opacities 0 and 1 stay finite in the file, and other readers
# can compute exp(20) in any precision.
OPACITY_LOGIT_MAX = 20.0
# A scale of 0 is written as the logarithm of the smallest normal float32, -87.3.
SCALE_MIN = float(np.finfo(np.float32).tiny)


def write_ply(path: AnyPath, cloud: SplatCloud) -> None:
    """Writes `cloud` as binary little-endian float32 with the properties of INRIA's trainer, normals zero.

    Scales become logarithms, at least log(1.2e-38); opacities become logits within ±20, so that reading them again
    differs by less than 1e-6; SH coefficients and rotations are written as they are. Values are not checked: a cloud
    from a reader has only finite ones. The file is replaced in one step; peak memory is a few MiB.

    Raises StippleError where the file cannot be written.
    """
    order = file_order(cloud.sh_rest.shape[1])
    columns = {
        name: np.array([order.index(column) for column in properties], np.intp)
        for name, properties in properties_of_arrays(cloud.sh_rest.shape[1]).items()
    }
    header = ["ply", "format binary_little_endian 1.0", f"element vertex {cloud.splat_count}"]
    header += [f"property float {name}" for name in order] + ["end_header", ""]
    with replacing(Path(path)) as file:
        file.write("\n".join(header).encode("ascii"))
        for first in range(0, cloud.splat_count, BLOCK_ROWS):
            block = slice(first, min(first + BLOCK_ROWS, cloud.splat_count))
            rows = np.zeros((block.stop - first, len(order)), "<f4")
            for name in ("position", "rotation", "sh_dc", "sh_rest"):
                rows[:, columns[name]] = getattr(cloud, name)[block].reshape(len(rows), -1)
            rows[:, columns["scale"]] = np.log(np.maximum(cloud.scale[block], SCALE_MIN))
            rows[:, columns["opacity"]] = _logit(cloud.opacity[block])[:, None]
            file.write(rows.data)


def _logit(opacity: FloatArray) -> FloatArray:
    exact = opacity.astype(np.float64)  # 1 - opacity loses its digits in float32
    with np.errstate(all="ignore"):
        logit = np.log(exact) - np.log1p(-exact)
    clipped: FloatArray = np.clip(logit, -OPACITY_LOGIT_MAX, OPACITY_LOGIT_MAX).astype(np.float32)
    return clipped
