# SPDX-License-Identifier: GPL-3.0-or-later
"""PLY files made by hand for the other PLY tests, and the check that plyfile reads in them what was put in.

Shares no code with the engine's reader and writer: `expected` is the float64 definition of the activations.
"""

from __future__ import annotations

import io
import struct
from dataclasses import dataclass, field

import numpy as np
import plyfile
import pytest

# PLY type: NumPy type without its byte order
TYPES = {"char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4"}
TYPES |= {"float": "f4", "double": "f8", "float32": "f4", "float64": "f8", "uint8": "u1"}
ENCODINGS = ("ascii", "binary_little_endian", "binary_big_endian")
REST_COUNTS = (0, 3, 8, 15, 24)


def splat_properties(rest_count: int, normals: bool = True) -> list[str]:
    """Names in the order of INRIA's trainer."""
    names = ["x", "y", "z", *(["nx", "ny", "nz"] if normals else []), "f_dc_0", "f_dc_1", "f_dc_2"]
    names += [f"f_rest_{index}" for index in range(3 * rest_count)]
    return [*names, "opacity", "scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3"]


def random_columns(count: int, rest_count: int, seed: int = 0, normals: bool = True) -> dict[str, np.ndarray]:
    """Plausible raw values, exactly representable in float32."""
    rng = np.random.default_rng(seed)
    columns = {name: rng.normal(size=count) for name in splat_properties(rest_count, normals)}
    for axis in range(3):
        columns[f"scale_{axis}"] -= 4.0
    return {name: column.astype(np.float32).astype(np.float64) for name, column in columns.items()}


@dataclass
class Element:
    """Columns of one element; `types` gives those that are not float; `lists` are (length type, value type, rows)."""

    name: str
    columns: dict[str, np.ndarray]
    types: dict[str, str] = field(default_factory=dict)
    lists: dict[str, tuple[str, str, list[list[int]]]] = field(default_factory=dict)

    @property
    def count(self) -> int:
        columns = [*self.columns.values(), *(rows for _, _, rows in self.lists.values())]
        return len(columns[0]) if columns else 0

    def header(self) -> list[str]:
        lines = [f"element {self.name} {self.count}"]
        lines += [f"property {self.types.get(name, 'float')} {name}" for name in self.columns]
        return lines + [f"property list {length} {kind} {name}" for name, (length, kind, _) in self.lists.items()]

    def body(self, encoding: str, newline: str) -> bytes:
        if not self.lists and encoding != "ascii":
            order = "<" if "little" in encoding else ">"
            dtype = [(name, order + TYPES[self.types.get(name, "float")]) for name in self.columns]
            rows = np.empty(self.count, dtype)
            for name, column in self.columns.items():
                rows[name] = column
            return rows.tobytes()
        return b"".join(self._row(index, encoding, newline) for index in range(self.count))

    def _row(self, index: int, encoding: str, newline: str) -> bytes:
        values: list[tuple[str, float]] = []
        for name, column in self.columns.items():
            values.append((TYPES[self.types.get(name, "float")], column[index]))
        for length, kind, rows in self.lists.values():
            values.append((TYPES[length], len(rows[index])))
            values += [(TYPES[kind], value) for value in rows[index]]
        if encoding == "ascii":
            texts = (repr(float(value)) if kind[0] == "f" else str(int(value)) for kind, value in values)
            return (" ".join(texts) + newline).encode("ascii")
        codes = {"i1": "b", "u1": "B", "i2": "h", "u2": "H", "i4": "i", "u4": "I", "f4": "f", "f8": "d"}
        order = "<" if "little" in encoding else ">"
        return b"".join(
            struct.pack(order + codes[kind], float(value) if kind[0] == "f" else int(value)) for kind, value in values
        )


def ply_bytes(
    *elements: Element, encoding: str = "binary_little_endian", newline: str = "\n", comments: tuple[str, ...] = ()
) -> bytes:
    lines = ["ply", f"format {encoding} 1.0", *(f"comment {comment}" for comment in comments)]
    for element in elements:
        lines += element.header()
    header = newline.join([*lines, "end_header", ""]).encode("utf-8")
    return header + b"".join(element.body(encoding, newline) for element in elements)


def splat_bytes(columns: dict[str, np.ndarray], **options: str) -> bytes:
    return ply_bytes(Element("vertex", columns), **options)


def expected(columns: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """The arrays of the cloud, in float64."""
    rotation = np.stack([columns[f"rot_{axis}"] for axis in range(4)], axis=1)
    rest_count = sum(name.startswith("f_rest_") for name in columns) // 3
    sh_rest = np.empty((len(rotation), rest_count, 3))
    for channel in range(3):
        for coefficient in range(rest_count):
            sh_rest[:, coefficient, channel] = columns[f"f_rest_{channel * rest_count + coefficient}"]
    return {
        "position": np.stack([columns[axis] for axis in "xyz"], axis=1),
        "scale": np.exp(np.stack([columns[f"scale_{axis}"] for axis in range(3)], axis=1)),
        "rotation": rotation / np.linalg.norm(rotation, axis=1, keepdims=True),
        "opacity": 1 / (1 + np.exp(-columns["opacity"])),
        "sh_dc": np.stack([columns[f"f_dc_{channel}"] for channel in range(3)], axis=1),
        "sh_rest": sh_rest,
    }


def assert_cloud(cloud: object, columns: dict[str, np.ndarray]) -> None:
    """Raw values must be exact, activated ones within float32 rounding."""
    for name, values in expected(columns).items():
        found = getattr(cloud, name)
        assert found.dtype == np.float32
        assert found.shape == values.shape, name
        tolerance = 0 if name in ("position", "sh_dc", "sh_rest") else 4e-7
        np.testing.assert_allclose(found, values, rtol=tolerance, atol=tolerance * 0.25, err_msg=name)


@pytest.mark.parametrize("encoding", ENCODINGS)
@pytest.mark.parametrize("newline", ["\n", "\r\n"])
def test_plyfile_reads_the_hand_made_files(encoding: str, newline: str) -> None:
    columns = random_columns(5, 3)
    faces = Element("face", {}, lists={"vertex_indices": ("uchar", "int", [[0, 1, 2], [1, 2, 3, 4]])})
    vertex = Element("vertex", columns, {"x": "double", "nx": "short"})
    vertex.columns["nx"] = np.arange(5) - 2
    content = ply_bytes(faces, vertex, encoding=encoding, newline=newline)
    parsed = plyfile.PlyData.read(io.BytesIO(content))
    assert [list(row) for row in parsed["face"]["vertex_indices"]] == [[0, 1, 2], [1, 2, 3, 4]]
    for name, column in vertex.columns.items():
        np.testing.assert_array_equal(parsed["vertex"][name], column, err_msg=name)
