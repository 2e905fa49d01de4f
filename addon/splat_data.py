# SPDX-License-Identifier: GPL-3.0-or-later
"""Splats as point attributes of a datablock: a PointCloud where Python can size one (Blender 5.2), else a Mesh.

Names and meanings are those of Blender 5.3's native Gaussian splats:

| attribute       | type                                  | holds                                                    |
|-----------------|---------------------------------------|----------------------------------------------------------|
| `position`      | FLOAT_VECTOR                          | mean [object units]                                      |
| `scale`         | FLOAT_VECTOR                          | standard deviations along the principal axes             |
| `rotation`      | QUATERNION                            | w, x, y, z                                               |
| `radiance:base` | FLOAT4 (FLOAT_COLOR before 5.2)       | raw SH DC r, g, b and activated opacity                  |
| `radiance:sh_0` | FLOAT_VECTOR, one per SH coefficient  | raw coefficients of the bands above 0, in order, r, g, b |
| `stipple_state` | INT, only while there is something    | flags of an edit: the bits of `engine.edit.state`        |

Values travel bit by bit in both directions. Reading accepts original and evaluated datablocks of either kind, and what
the PLY importer of Blender 5.3 makes; there, a PointCloud of this module has the type that Blender's engines draw as
splats.
"""

from __future__ import annotations

from collections.abc import Collection
from typing import Any

import bpy
import numpy as np
import numpy.typing as npt

from ..engine.errors import StippleError
from ..engine.splats import ARRAY_NAMES, SH_REST_COUNT, SplatCloud, degenerate_mask

FloatArray = npt.NDArray[np.float32]

BASE = "radiance:base"
SH_PREFIX = "radiance:sh_"
STATE = "stipple_state"
SOURCE_PROPERTY = "stipple_source"  # custom property of the datablock: the file it was read from
SPLATS_AT_ONCE = 2048  # whose coefficients stay in the cache
POINT_TYPES = ("POINTCLOUD", "MESH")  # object types that can carry a capture

# RNA property and width of one element, per attribute type.
ELEMENTS = {
    "FLOAT": ("value", 1),
    "FLOAT_VECTOR": ("vector", 3),
    "QUATERNION": ("value", 4),
    "FLOAT4": ("vector", 4),
    "FLOAT_COLOR": ("color", 4),
}
FOUR_WIDE = ("QUATERNION", "FLOAT4", "FLOAT_COLOR")
READABLE_TYPES = {
    "position": ("FLOAT_VECTOR",),
    "scale": ("FLOAT_VECTOR",),
    "rotation": FOUR_WIDE,
    BASE: FOUR_WIDE,
    "radius": ("FLOAT",),
}


def is_capture(b_data: Any) -> bool:
    """Whether a datablock says that it is a capture: a PointCloud or Mesh with `radiance:base`."""
    return isinstance(b_data, (bpy.types.PointCloud, bpy.types.Mesh)) and BASE in b_data.attributes


def is_capture_object(b_object: Any) -> bool:
    """Whether an object (or None) carries a capture of its own, whatever its modifiers make of it."""
    return b_object is not None and b_object.type in POINT_TYPES and is_capture(b_object.data)


def splat_count_of(b_data: Any) -> int:
    """Points or vertices of the datablock."""
    return len(b_data.points if isinstance(b_data, bpy.types.PointCloud) else b_data.vertices)


def datablock_from_cloud(cloud: SplatCloud, name: str) -> Any:
    """A new PointCloud or Mesh that holds the cloud; no object uses it yet. Leaves nothing behind if it fails."""
    b_data = _new_points(name, cloud.splat_count)
    try:
        write_cloud(b_data, cloud)
    except BaseException:
        bpy.data.batch_remove([b_data])
        raise
    return b_data


def write_cloud(b_data: Any, cloud: SplatCloud) -> None:
    """Writes every attribute of the cloud to a datablock of as many points; other attributes stay as they are."""
    write_arrays(b_data, cloud, ARRAY_NAMES)


def write_arrays(b_data: Any, cloud: SplatCloud, names: Collection[str]) -> None:
    """As `write_cloud`, but only the arrays of the cloud that are named."""
    for name, data_type in (("position", "FLOAT_VECTOR"), ("scale", "FLOAT_VECTOR"), ("rotation", "QUATERNION")):
        if name in names:
            write_attribute(b_data, name, data_type, getattr(cloud, name))
    if "sh_dc" in names or "opacity" in names:
        base = np.concatenate([cloud.sh_dc, cloud.opacity[:, None]], axis=1)
        write_attribute(b_data, BASE, _base_type(), base)
    if "sh_rest" in names:
        for index, plane in enumerate(_planes(cloud.sh_rest)):
            write_attribute(b_data, f"{SH_PREFIX}{index}", "FLOAT_VECTOR", plane)
    if ("scale" in names or "opacity" in names) and isinstance(b_data, bpy.types.PointCloud):
        write_attribute(b_data, "radius", "FLOAT", display_radius(cloud.scale, cloud.opacity))
    b_data.update_tag()


def _planes(sh_rest: FloatArray) -> FloatArray:
    """Coefficients (N, C, 3) as (C, N, 3), some splats at a time: column by column each line of the cache would be
    fetched five times (172 ms for a million splats of degree 3, 72 so; one EPYC core).
    """
    count, rest_count, _ = sh_rest.shape
    planes = np.empty((rest_count, count, 3), np.float32)
    triples = np.dtype("V12")  # three floats, moved as one
    source, target = sh_rest.view(triples)[..., 0], planes.view(triples)[..., 0]
    for first in range(0, count, SPLATS_AT_ONCE):
        target[:, first : first + SPLATS_AT_ONCE] = source[first : first + SPLATS_AT_ONCE].T
    return planes


def states_of(b_data: Any) -> npt.NDArray[np.uint32] | None:
    """The flags of every point (N,), a copy; None where there is no attribute for them."""
    b_attribute = b_data.attributes.get(STATE)
    if b_attribute is None or b_attribute.domain != "POINT" or b_attribute.data_type != "INT":
        return None
    states = np.empty(len(b_attribute.data), np.uint32)
    b_attribute.data.foreach_get("value", states)
    return states


def write_states(b_data: Any, states: npt.NDArray[np.uint32]) -> None:
    """Writes the flags; the attribute is there only while one is set."""
    b_attribute = b_data.attributes.get(STATE)
    if b_attribute is not None and (not states.any() or states_of(b_data) is None):
        b_data.attributes.remove(b_attribute)
        b_attribute = None
    if states.any():
        b_attribute = b_attribute or b_data.attributes.new(STATE, "INT", "POINT")
        b_attribute.data.foreach_set("value", np.ascontiguousarray(states, np.uint32))
    b_data.update_tag()


def usable_rows(b_data: Any, name: str) -> npt.NDArray[np.bool_]:
    """Which points `cloud_from_datablock` does not leave out (N,). Raises StippleError as that does."""
    return ~_degenerate(_raw_arrays(b_data, name))


def cloud_from_datablock(b_data: Any, name: str) -> tuple[SplatCloud | None, int]:
    """The splats of a datablock, and how many were left out because they cannot be rendered.

    Values are copied unchanged, except that what Geometry Nodes may have broken is mended: quaternions whose
    length is off by more than 1e-4 are normalised and opacities are clipped to 0 … 1. Splats with non-finite values, a
    negative scale or a zero quaternion are left out. None when no splat remains. Raises StippleError, naming `name`,
    when an attribute is missing or has the wrong type or domain.
    """
    raw = position, scale, rotation, base, sh_rest = _raw_arrays(b_data, name)
    bad = _degenerate(raw)
    dropped = int(bad.sum())
    arrays = [position, scale, _unit(rotation, ~bad), np.clip(base[:, 3], 0, 1), base[:, :3], sh_rest]
    if dropped:
        arrays = [array[~bad] for array in arrays]
    if len(arrays[0]) == 0:
        return None, dropped
    contiguous = [np.ascontiguousarray(array) for array in arrays]
    return SplatCloud(**dict(zip(ARRAY_NAMES, contiguous, strict=True)), name=name), dropped


def _raw_arrays(b_data: Any, name: str) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]:
    """Position, scale, rotation, base and the higher coefficients as they are stored."""
    position, scale = read_attribute(b_data, "position", name), read_attribute(b_data, "scale", name)
    rotation, base = read_attribute(b_data, "rotation", name), read_attribute(b_data, BASE, name)
    sh_rest = np.empty((len(position), rest_count_of(b_data, name), 3), np.float32)
    for index in range(sh_rest.shape[1]):
        sh_rest[:, index] = read_attribute(b_data, f"{SH_PREFIX}{index}", name)
    return position, scale, rotation, base, sh_rest


def _degenerate(raw: tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]) -> npt.NDArray[np.bool_]:
    position, scale, rotation, base, sh_rest = raw
    return degenerate_mask(position, scale, rotation, base[:, 3], base) | ~np.isfinite(sh_rest).all(axis=(1, 2))


def _new_points(name: str, count: int) -> Any:
    if "resize" in bpy.types.PointCloud.bl_rna.functions:
        b_points = bpy.data.pointclouds.new(name)
        b_points.resize(count)
        if "type" in bpy.types.PointCloud.bl_rna.properties:  # Blender 5.3: its own engines then draw splats, too
            b_points.type = "GAUSSIAN_SPLAT"
        return b_points
    b_mesh = bpy.data.meshes.new(name)
    b_mesh.vertices.add(count)
    return b_mesh


def resize_points(b_data: Any, count: int) -> None:
    """Makes a datablock of this module have `count` points; what its attributes hold is undefined after that."""
    if splat_count_of(b_data) == count:
        return
    if isinstance(b_data, bpy.types.PointCloud):
        b_data.resize(count)
        return
    b_data.clear_geometry()
    b_data.vertices.add(count)


def _base_type() -> str:
    types = bpy.types.Attribute.bl_rna.properties["data_type"].enum_items
    return "FLOAT4" if "FLOAT4" in types else "FLOAT_COLOR"


def write_attribute(b_data: Any, attribute: str, data_type: str, values: FloatArray) -> None:
    if attribute not in b_data.attributes:
        b_data.attributes.new(attribute, data_type, "POINT")
    element, _ = ELEMENTS[b_data.attributes[attribute].data_type]
    b_data.attributes[attribute].data.foreach_set(element, np.ascontiguousarray(values, np.float32).reshape(-1))


def read_attribute(b_data: Any, attribute: str, name: str, buffer: FloatArray | None = None) -> FloatArray:
    """(N, width) float32, in `buffer` where there is one.

    Raises StippleError when the attribute is missing or unusable.
    """
    b_attribute = b_data.attributes.get(attribute)
    if b_attribute is None:
        raise StippleError(
            f"{name}: the point attribute {attribute!r} is missing; restore it or import the file again."
        )
    allowed = READABLE_TYPES.get(attribute, ("FLOAT_VECTOR",))
    if b_attribute.domain != "POINT" or b_attribute.data_type not in allowed:
        raise StippleError(
            f"{name}: the attribute {attribute!r} is {b_attribute.data_type} on {b_attribute.domain}; "
            f"store it as {allowed[0]} on POINT or import the file again."
        )
    element, width = ELEMENTS[b_attribute.data_type]
    size = splat_count_of(b_data) * width
    values = np.empty(size, np.float32) if buffer is None else buffer[:size]
    b_attribute.data.foreach_get(element, values)
    return values.reshape(-1, width)


def rest_count_of(b_data: Any, name: str) -> int:
    """Coefficients above band 0. Raises StippleError where they are of no complete degree."""
    count = 0
    while f"{SH_PREFIX}{count}" in b_data.attributes:
        count += 1
    if count not in SH_REST_COUNT:
        raise StippleError(
            f"{name}: there are {count} attributes {SH_PREFIX}0 … {SH_PREFIX}{count - 1}; "
            f"keep 3, 8, 15 or 24 of them for a complete degree, or none."
        )
    return count


def _unit(rotation: FloatArray, usable: npt.NDArray[np.bool_]) -> FloatArray:
    """Normalises the quaternions that need it and leaves every other bit alone."""
    norm = np.sqrt(np.square(rotation).sum(axis=1))
    off = usable & (np.abs(norm - 1) > 1e-4)
    if off.any():
        rotation[off] /= norm[off, None]
    return rotation


def display_radius(scale: FloatArray, opacity: FloatArray) -> FloatArray:
    """Point radii for Solid shading [object units], so large that points of a surface touch.

    Then the outline of a selected capture runs around it and not around every point. Large splats are cut so that none
    hides the rest, and faint ones are small.
    """
    x, y, z = scale.T
    middle = np.maximum(np.minimum(x, y), np.minimum(np.maximum(x, y), z))  # a tenth of what np.median takes
    radius = np.float32(2.5) * middle
    radius = np.minimum(radius, 4 * np.median(radius))
    return (radius * np.sqrt(np.clip(opacity, 0, 1))).astype(np.float32)
