# SPDX-License-Identifier: GPL-3.0-or-later
"""Fewer or more points in a datablock, with every point attribute kept that the points have, a user's own included."""

from __future__ import annotations

from collections.abc import Collection
from typing import Any

import bpy
import numpy as np
import numpy.typing as npt

from ..engine.errors import StippleError
from .splat_data import resize_points

# RNA property, width and kind of one element, per attribute type.
COLUMNS: dict[str, tuple[str, int, type]] = {
    "FLOAT": ("value", 1, np.float32),
    "INT": ("value", 1, np.int32),
    "BOOLEAN": ("value", 1, np.bool_),
    "INT8": ("value", 1, np.int8),
    "FLOAT2": ("vector", 2, np.float32),
    "FLOAT_VECTOR": ("vector", 3, np.float32),
    "FLOAT4": ("vector", 4, np.float32),
    "FLOAT_COLOR": ("color", 4, np.float32),
    "BYTE_COLOR": ("color_srgb", 4, np.float32),
    "QUATERNION": ("value", 4, np.float32),
    "INT16_2D": ("value", 2, np.int32),
    "INT32_2D": ("value", 2, np.int32),
    "FLOAT4X4": ("value", 16, np.float32),
}
Rows = npt.NDArray[np.integer]
Columns = dict[str, tuple[str, npt.NDArray[Any]]]
"""Attributes by name: their type, and a row of values (N, width) for each point."""


def check_points_only(b_data: Any, name: str) -> None:
    """Raises StippleError, naming `name`, for a datablock whose points cannot be taken out or added one by one."""
    if isinstance(b_data, bpy.types.Mesh) and (len(b_data.edges) or len(b_data.polygons)):
        raise StippleError(f"{name}: its mesh has edges or faces; edit a capture of loose points only.")
    if isinstance(b_data, bpy.types.Mesh) and b_data.shape_keys:
        raise StippleError(f"{name}: its mesh has shape keys; remove them before changing the number of splats.")
    check_columns(points_own(b_data), name)


def check_columns(b_attributes: list[Any], name: str) -> None:
    """Raises StippleError, naming `name`, for an attribute of a type whose values cannot be moved."""
    for b_attribute in b_attributes:
        if b_attribute.data_type not in COLUMNS:
            raise StippleError(
                f"{name}: the attribute {b_attribute.name!r} is {b_attribute.data_type}, which cannot follow "
                "a changed number of splats; remove it first."
            )


def replace_points(
    b_data: Any, rows: Rows, name: str, rewritten: Collection[str] = (), added: Columns | None = None
) -> None:
    """Point k becomes what point rows[k] was; a negative row gives a point whose attributes are those of the next row
    of `added`, and all others 0. Attributes that only `added` has are made.

    Attributes called in `rewritten` are left undefined, for whoever writes them next. Raises StippleError as
    `check_points_only`; everything that needs memory comes before the first change.
    """
    check_points_only(b_data, name)
    added, blank = added or {}, rows < 0
    source = np.where(blank, 0, rows)
    columns: list[tuple[str, str, npt.NDArray[Any] | None]] = []
    for b_attribute in points_own(b_data):
        taken = None
        if b_attribute.name not in rewritten:
            taken = np.take(values_of(b_attribute), source, axis=0)
            taken[blank] = added[b_attribute.name][1] if b_attribute.name in added else 0
        columns.append((b_attribute.name, b_attribute.data_type, taken))
    known = [attribute for attribute, _, _ in columns]
    for attribute, (data_type, values) in added.items():
        if attribute not in known:
            taken = np.zeros((len(rows), values.shape[1]), values.dtype)
            taken[blank] = values
            columns.append((attribute, data_type, taken))
    resize_points(b_data, len(rows))
    for attribute, data_type, kept in columns:
        if attribute not in b_data.attributes:
            b_data.attributes.new(attribute, data_type, "POINT")
        if kept is not None:
            b_data.attributes[attribute].data.foreach_set(COLUMNS[data_type][0], kept.reshape(-1))


def values_of(b_attribute: Any) -> npt.NDArray[Any]:
    """(N, width) of a point attribute of a type in `COLUMNS`, a copy."""
    element, width, kind = COLUMNS[b_attribute.data_type]
    values: npt.NDArray[Any] = np.empty((len(b_attribute.data), width), kind)
    b_attribute.data.foreach_get(element, values.reshape(-1))
    return values


def points_own(b_data: Any) -> list[Any]:
    """Point attributes that are not Blender's internal ones."""
    return [b_one for b_one in b_data.attributes if b_one.domain == "POINT" and not b_one.name.startswith(".")]
