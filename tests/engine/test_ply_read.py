# SPDX-License-Identifier: GPL-3.0-or-later
"""Reading splat PLY files in every encoding and layout; what cannot be rendered is left out and counted."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import plyfile
import pytest

from stipple.engine.errors import StippleError
from stipple.engine.formats import read_splats, readable_suffixes
from stipple.engine.splats import ARRAY_NAMES, degenerate_mask
from tests.engine.test_ply_files import (
    ENCODINGS,
    REST_COUNTS,
    Element,
    assert_cloud,
    ply_bytes,
    random_columns,
    splat_bytes,
)

DATA = Path(__file__).parents[3] / "shared" / "data"


def put(folder: Path, content: bytes, name: str = "tree.ply") -> Path:
    path = folder / name
    path.write_bytes(content)
    return path


@pytest.mark.parametrize("encoding", ENCODINGS)
@pytest.mark.parametrize("degree", range(5))
def test_every_encoding_and_degree(tmp_path: Path, encoding: str, degree: int) -> None:
    columns = random_columns(7, REST_COUNTS[degree], seed=degree)
    loaded = read_splats(put(tmp_path, splat_bytes(columns, encoding=encoding)))
    assert (loaded.dropped, loaded.warnings) == (0, ())
    assert loaded.cloud.name == "tree"
    assert loaded.cloud.sh_degree == degree
    assert_cloud(loaded.cloud, columns)


def random_file(seed: int) -> tuple[bytes, dict[str, np.ndarray]]:
    """A splat file with everything that may vary varied, and its columns."""
    rng = np.random.default_rng(seed)
    count, rest_count = int(rng.integers(1, 40)), REST_COUNTS[rng.integers(0, 5)]
    columns = random_columns(count, rest_count, seed, normals=bool(rng.integers(0, 2)))
    types = {name: "double" for name in columns if rng.random() < rng.choice([0.0, 0.1, 1.0])}
    for index, kind in enumerate(rng.choice(["uchar", "char", "short", "uint", "float64"], rng.integers(0, 4))):
        columns[f"extra_{index}"] = rng.integers(0, 100, count)
        types[f"extra_{index}"] = str(kind)
    names = [str(name) for name in rng.permutation(list(columns))]
    vertex = Element("vertex", {name: columns[name] for name in names}, types)
    chunk = Element("chunk", {"a": np.arange(3), "b": np.arange(3) + 0.5}, {"a": "ushort"})
    faces = Element("face", {}, lists={"vertex_indices": ("uchar", "int", [[0, 1, 2], []])})
    before = [element for element in (chunk, faces) if rng.random() < 0.3]
    after = [element for element in (chunk, faces) if element not in before and rng.random() < 0.5]
    encoding, newline = ENCODINGS[rng.integers(0, 3)], str(rng.choice(["\n", "\r\n"]))
    return ply_bytes(*before, vertex, *after, encoding=encoding, newline=newline), columns


@pytest.mark.parametrize("seed", range(60))
def test_any_order_types_extras_and_elements(tmp_path: Path, seed: int) -> None:
    content, columns = random_file(seed)
    loaded = read_splats(put(tmp_path, content))
    assert loaded.dropped == 0
    assert_cloud(loaded.cloud, columns)


@pytest.mark.parametrize("encoding", ENCODINGS)
def test_an_extra_list_among_the_properties(tmp_path: Path, encoding: str) -> None:
    columns = random_columns(3, 0)
    vertex = Element("vertex", columns, lists={"neighbours": ("uchar", "int", [[1], [], [0, 1]])})
    assert_cloud(read_splats(put(tmp_path, ply_bytes(vertex, encoding=encoding))).cloud, columns)


def test_integer_properties(tmp_path: Path) -> None:
    columns = random_columns(3, 0)
    columns["opacity"], columns["x"] = np.array([0, 2, 5]), np.array([-3, 0, 3000])
    vertex = Element("vertex", columns, {"opacity": "uchar", "x": "short"})
    assert_cloud(read_splats(put(tmp_path, ply_bytes(vertex))).cloud, columns)


@pytest.mark.parametrize("encoding", ["binary_little_endian", "binary_big_endian"])
def test_many_blocks(tmp_path: Path, encoding: str) -> None:
    columns = random_columns(20_000, 3)  # 2 MB, so 32 blocks from two threads
    assert_cloud(read_splats(put(tmp_path, splat_bytes(columns, encoding=encoding))).cloud, columns)


def test_comments_need_not_be_ascii(tmp_path: Path) -> None:
    columns = random_columns(3, 0)
    for encoding in ENCODINGS:
        content = ply_bytes(Element("vertex", columns), encoding=encoding, comments=("Frühling 春", ""))
        assert_cloud(read_splats(put(tmp_path, content)).cloud, columns)


def test_bytes_after_the_last_row_are_ignored(tmp_path: Path) -> None:
    columns = random_columns(3, 0)
    assert_cloud(read_splats(put(tmp_path, splat_bytes(columns) + b"more")).cloud, columns)


@pytest.mark.parametrize("name", ["TREE.PLY", "tree.txt", "tree"])
def test_content_decides_before_the_suffix(tmp_path: Path, name: str) -> None:
    columns = random_columns(2, 0)
    assert_cloud(read_splats(str(put(tmp_path, splat_bytes(columns), name))).cloud, columns)
    assert readable_suffixes() == (".ply",)


BAD = [("x", np.nan), ("z", np.inf), ("f_dc_1", -np.inf), ("f_rest_8", np.nan), ("opacity", np.inf)]
BAD += [("opacity", -np.inf), ("opacity", np.nan), ("scale_0", -np.inf), ("scale_1", np.nan), ("rot_3", np.inf)]


@pytest.mark.parametrize("encoding", ENCODINGS)
@pytest.mark.parametrize(("name", "value"), BAD)
def test_a_value_that_is_not_finite_drops_the_splat(tmp_path: Path, encoding: str, name: str, value: float) -> None:
    columns = random_columns(6, 3)
    columns[name][[1, 4]] = value
    path = put(tmp_path, splat_bytes(columns, encoding=encoding))
    loaded = read_splats(path)
    assert loaded.dropped == 2
    assert loaded.warnings == (f"{path}: 2 of 6 splats were left out: {name} is not finite in 2.",)
    assert_cloud(loaded.cloud, {key: np.delete(column, [1, 4]) for key, column in columns.items()})


@pytest.mark.parametrize("value", [0.0, 1e-13, 1e30])
def test_quaternions_without_direction_are_dropped(tmp_path: Path, value: float) -> None:
    columns = random_columns(6, 0)
    for axis in range(4):
        columns[f"rot_{axis}"][2] = value  # 1e30: the square is beyond float32
    loaded = read_splats(put(tmp_path, splat_bytes(columns)))
    assert loaded.dropped == 1
    assert "rot_0 … rot_3 has no direction in 1" in loaded.warnings[0]
    assert_cloud(loaded.cloud, {key: np.delete(column, 2) for key, column in columns.items()})


def test_overflowing_scales_are_dropped(tmp_path: Path) -> None:
    columns = random_columns(6, 0)
    columns["scale_2"][5] = 89.0  # exp(89) is above the largest float32
    loaded = read_splats(put(tmp_path, splat_bytes(columns)))
    assert loaded.dropped == 1
    assert "scale_2 is too large in 1" in loaded.warnings[0]
    assert_cloud(loaded.cloud, {key: np.delete(column, 5) for key, column in columns.items()})


def test_a_warning_about_much_stays_short(tmp_path: Path) -> None:
    columns = {name: np.where(np.arange(4) == 1, np.nan, column) for name, column in random_columns(4, 15).items()}
    warning = read_splats(put(tmp_path, splat_bytes(columns))).warnings[0]
    assert warning.endswith("scale_0 is not finite in 1, scale_1 is not finite in 1 and 54 more.")


def test_a_double_beyond_float32_is_dropped(tmp_path: Path) -> None:
    columns = random_columns(2, 0)
    columns["y"][0] = 1e300
    loaded = read_splats(put(tmp_path, ply_bytes(Element("vertex", columns, {"y": "double"}))))
    assert loaded.dropped == 1
    assert "y is not finite in 1" in loaded.warnings[0]


def test_bad_splats_across_blocks_leave_the_others_in_order(tmp_path: Path) -> None:
    columns = random_columns(150_000, 3)
    bad = np.random.default_rng(5).random(150_000) < 0.3
    columns["f_rest_4"][bad] = np.nan
    loaded = read_splats(put(tmp_path, splat_bytes(columns)))
    assert loaded.dropped == bad.sum()
    assert_cloud(loaded.cloud, {name: column[~bad] for name, column in columns.items()})
    cloud = loaded.cloud
    assert not degenerate_mask(cloud.position, cloud.scale, cloud.rotation, cloud.opacity, cloud.sh_rest).any()


def test_only_bad_splats_is_an_error(tmp_path: Path) -> None:
    columns = random_columns(3, 0)
    columns["y"][:] = np.nan
    with pytest.raises(StippleError, match=r"all of its 3 splats are unusable: y is not finite in 3"):
        read_splats(put(tmp_path, splat_bytes(columns)))


def test_extreme_but_finite_splats_are_kept(tmp_path: Path) -> None:
    columns = random_columns(4, 0)
    columns["x"][:] = 3e38  # their sum overflows float32
    columns["scale_0"][0] = -200.0  # a flat disc
    columns["opacity"][:2] = [-200.0, 200.0]
    columns["nx"][:] = np.nan  # not used
    for axis in range(4):
        columns[f"rot_{axis}"][1] *= 1e-9
    columns = {name: column.astype(np.float32).astype(np.float64) for name, column in columns.items()}
    loaded = read_splats(put(tmp_path, splat_bytes(columns)))
    assert loaded.dropped == 0
    assert_cloud(loaded.cloud, columns)
    assert loaded.cloud.scale[0, 0] == 0.0


@pytest.mark.real
@pytest.mark.parametrize(
    ("file", "count", "degree"),
    [
        ("real/koala.ply", 54_804, 0),
        ("real/rubber_toy_cloud.ply", 14_364, 3),
        ("real/train-1000.ply", 1_000, 3),
        ("formats/fruit_drops_minimal.ply", 4_721, 3),
    ],
)
def test_real_captures(file: str, count: int, degree: int) -> None:
    if not (DATA / file).exists():
        pytest.skip("../shared/data is absent")
    loaded = read_splats(DATA / file)
    cloud = loaded.cloud
    assert (cloud.splat_count, cloud.sh_degree, loaded.dropped) == (count, degree, 0)
    assert all(np.isfinite(getattr(cloud, name)).all() for name in ARRAY_NAMES)
    data = plyfile.PlyData.read(DATA / file)["vertex"].data
    assert_cloud(cloud, {name: data[name].astype(np.float64) for name in data.dtype.names})
    assert cloud.scale.min() >= 0
    assert 0 <= cloud.opacity.min() < cloud.opacity.max() <= 1


def test_importing_the_registry_imports_nothing_heavy() -> None:
    code = "import sys, stipple.engine.formats; print({'warp', 'bpy', 'plyfile'} & set(sys.modules))"
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)}
    run = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True)
    assert run.stdout.strip() == "set()"
