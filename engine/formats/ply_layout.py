# SPDX-License-Identifier: GPL-3.0-or-later
"""Which properties of a PLY file's vertices make it a splat file, and in which order they stand in memory.

The layout is that of INRIA's 3D Gaussian Splatting (Kerbl et al. 2023, `save_ply` of its trainer). `f_rest_*` is
channel-major in the file (every red coefficient, then green, then blue) and coefficient-major in memory.
"""

from __future__ import annotations

import re
from pathlib import Path

from ..errors import StippleError
from ..splats import SH_REST_COUNT
from .ply_header import PlyElement, PlyHeader

POSITION = ("x", "y", "z")
NORMAL = ("nx", "ny", "nz")
SH_DC = ("f_dc_0", "f_dc_1", "f_dc_2")
OPACITY = ("opacity",)
SCALE = ("scale_0", "scale_1", "scale_2")
ROTATION = ("rot_0", "rot_1", "rot_2", "rot_3")  # w, x, y, z
REQUIRED = OPACITY + SCALE + ROTATION + SH_DC + POSITION  # the most telling first, for messages


def properties_of_arrays(rest_count: int) -> dict[str, tuple[str, ...]]:
    """For each array of `SplatCloud`, the properties that are its columns, in memory order.

    `rest_count`: SH coefficients per channel above band 0; `sh_rest` is flattened from (N, rest_count, 3).
    """
    sh_rest = tuple(
        f"f_rest_{channel * rest_count + coefficient}" for coefficient in range(rest_count) for channel in range(3)
    )
    return {
        "position": POSITION,
        "scale": SCALE,
        "rotation": ROTATION,
        "opacity": OPACITY,
        "sh_dc": SH_DC,
        "sh_rest": sh_rest,
    }


def file_order(rest_count: int) -> tuple[str, ...]:
    """All properties in INRIA's order, normals included."""
    sh_rest = tuple(f"f_rest_{index}" for index in range(3 * rest_count))
    return POSITION + NORMAL + SH_DC + sh_rest + OPACITY + SCALE + ROTATION


def splat_element(header: PlyHeader, path: Path) -> tuple[PlyElement, int]:
    """The element that holds the splats, and its SH coefficients per channel above band 0.

    Raises StippleError for what is not a splat file: a mesh, a point cloud, a compressed PLY, no splats, a property
    that is missing or a list, an incomplete SH degree.
    """
    vertex = header.element("vertex")
    if vertex is None:
        raise StippleError(f"{path}: this is not a splat file (it has no element 'vertex'); choose a 3DGS .ply file.")
    scalars = frozenset(vertex.dtype.names or ())
    if "packed_position" in scalars:
        raise StippleError(
            f"{path}: compressed PLY (PlayCanvas, SuperSplat; property 'packed_position') is not supported yet; "
            f"open it in SuperSplat and export an uncompressed .ply."
        )
    for name in REQUIRED:
        if name in vertex.lists:
            raise StippleError(
                f"{path}: the property '{name}' is a list, a splat needs one number; export it again as a 3DGS .ply."
            )
    missing = [name for name in REQUIRED if name not in scalars]
    if missing:
        raise _not_splats(header, missing, path)
    rest_count = _rest_count(scalars, vertex.lists, path)
    if vertex.count == 0:
        raise StippleError(f"{path}: there are zero splats in it (element 'vertex' 0); choose a file with some.")
    return vertex, rest_count


def _not_splats(header: PlyHeader, missing: list[str], path: Path) -> StippleError:
    names = ", ".join(f"'{name}'" for name in missing)
    lacks = f"the vertex {'property' if len(missing) == 1 else 'properties'} {names}"
    if len(missing) < 8 and "scale_0" not in missing:
        return StippleError(f"{path}: this splat file lacks {lacks}; export it again with the full 3DGS layout.")
    kind = "a mesh" if any(element.name in ("face", "tristrips") for element in header.elements) else "a point cloud"
    return StippleError(
        f"{path}: this is {kind}, not a splat capture, for it lacks {lacks}; choose the .ply of a 3DGS training run."
    )


def _rest_count(scalars: frozenset[str], lists: frozenset[str], path: Path) -> int:
    found = {name for name in scalars | lists if re.fullmatch(r"f_rest_\d+", name)}
    counts = [3 * count for count in SH_REST_COUNT]
    if len(found) not in counts:
        raise StippleError(
            f"{path}: there are {len(found)} properties 'f_rest_*', a complete degree has "
            f"{', '.join(map(str, counts[:-1]))} or {counts[-1]}; export it again with all of them."
        )
    for index in range(len(found)):
        name = f"f_rest_{index}"
        if name not in scalars:
            fault = (
                "is a list, a splat needs one number" if name in lists else f"is missing among {len(found)} f_rest_*"
            )
            raise StippleError(f"{path}: the property '{name}' {fault}; export it again with the full 3DGS layout.")
    return len(found) // 3
