# SPDX-License-Identifier: GPL-3.0-or-later
"""The point attributes that users and nodes have put on a capture, carried along where its splats go to another one."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ..engine.errors import StippleError
from ..engine.splats import SplatCloud
from .point_rows import COLUMNS, Columns, Rows, check_columns, points_own, values_of
from .splat_data import BASE, SH_PREFIX, STATE

OF_SPLATS = {"position", "scale", "rotation", BASE, "radius", STATE}


def own_columns(b_data: Any, rows: Rows, name: str) -> Columns:
    """What a datablock has beside its splats, of the points that `rows` names.

    Raises StippleError, naming `name`, for an attribute of a type that cannot be carried.
    """
    b_owns = [b_one for b_one in points_own(b_data) if b_one.name not in OF_SPLATS]
    b_owns = [b_one for b_one in b_owns if not b_one.name.startswith(SH_PREFIX)]
    check_columns(b_owns, name)
    return {b_one.name: (b_one.data_type, values_of(b_one)[rows]) for b_one in b_owns}


def put_columns(b_data: Any, columns: Columns) -> None:
    """Gives a datablock of as many points the attributes; none of them is there yet."""
    for attribute, (data_type, values) in columns.items():
        b_attribute = b_data.attributes.new(attribute, data_type, "POINT")
        b_attribute.data.foreach_set(COLUMNS[data_type][0], values.reshape(-1))


def joined_columns(b_data: Any, name: str, parts: Sequence[tuple[SplatCloud, Columns]]) -> Columns:
    """The columns of several captures, one after the other, to be appended to those of a datablock.

    What one lacks is 0. Raises StippleError where an attribute is of one type here and of another there.
    """
    types = {b_one.name: (name, b_one.data_type) for b_one in points_own(b_data)}
    for cloud, columns in parts:
        for attribute, (data_type, _) in columns.items():
            first, known = types.setdefault(attribute, (cloud.name, data_type))
            if known != data_type:
                raise StippleError(
                    f"{cloud.name}: the attribute {attribute!r} is {data_type}, and {known} in {first}; "
                    "rename or convert one of them to join them."
                )
    joined: Columns = {}
    for attribute in dict.fromkeys(attribute for _, columns in parts for attribute in columns):
        data_type = types[attribute][1]
        _, width, kind = COLUMNS[data_type]
        values = [
            columns[attribute][1] if attribute in columns else np.zeros((cloud.splat_count, width), kind)
            for cloud, columns in parts
        ]
        joined[attribute] = (data_type, np.concatenate(values))
    return joined
