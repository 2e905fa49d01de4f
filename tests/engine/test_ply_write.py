# SPDX-License-Identifier: GPL-3.0-or-later
"""Writing splat PLY files: the layout, the inverse activations, and files that are whole or not there."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import plyfile
import pytest

from stipple.engine.errors import StippleError
from stipple.engine.formats import read_splats, write_splats
from stipple.engine.formats.atomic_file import replacing, replacing_together
from stipple.engine.splats import ARRAY_NAMES, SplatCloud
from tests.engine.test_ply_files import REST_COUNTS, splat_properties


def random_cloud(count: int, rest_count: int, seed: int = 0) -> SplatCloud:
    rng = np.random.default_rng(seed)
    rotation = rng.normal(size=(count, 4))
    arrays = {
        "position": rng.normal(size=(count, 3)),
        "scale": np.exp(rng.normal(-4, 2, size=(count, 3))),
        "rotation": rotation / np.linalg.norm(rotation, axis=1, keepdims=True),
        "opacity": rng.random(count),
        "sh_dc": rng.normal(size=(count, 3)),
        "sh_rest": rng.normal(size=(count, rest_count, 3)),
    }
    return SplatCloud(**{name: array.astype(np.float32) for name, array in arrays.items()}, name="random")


@pytest.mark.parametrize("rest_count", REST_COUNTS)
def test_round_trip(tmp_path: Path, rest_count: int) -> None:
    cloud = random_cloud(20_000 if rest_count == 3 else 11, rest_count)  # 20,000 are several blocks
    write_splats(tmp_path / "out.ply", cloud)
    loaded = read_splats(tmp_path / "out.ply")
    assert loaded.dropped == 0
    for name in ARRAY_NAMES:
        exact = name in ("position", "sh_dc", "sh_rest")
        tolerance = {"rtol": 0, "atol": 0} if exact else {"rtol": 4e-6 if name == "scale" else 0, "atol": 1e-6}
        np.testing.assert_allclose(getattr(loaded.cloud, name), getattr(cloud, name), **tolerance, err_msg=name)


def test_layout_is_that_of_the_trainer(tmp_path: Path) -> None:
    cloud = random_cloud(5, 3)
    write_splats(str(tmp_path / "out.PLY"), cloud)
    content = (tmp_path / "out.PLY").read_bytes()
    names = splat_properties(3)
    header = ["ply", "format binary_little_endian 1.0", "element vertex 5"]
    header += [f"property float {name}" for name in names] + ["end_header", ""]
    assert content.startswith("\n".join(header).encode("ascii"))
    assert len(content) == len("\n".join(header)) + 5 * 4 * len(names)
    vertex = plyfile.PlyData.read(tmp_path / "out.PLY")["vertex"]
    for channel in range(3):
        for coefficient in range(3):
            column = vertex[f"f_rest_{3 * channel + coefficient}"]
            np.testing.assert_array_equal(column, cloud.sh_rest[:, coefficient, channel])
    np.testing.assert_allclose(vertex["scale_1"], np.log(cloud.scale[:, 1].astype(np.float64)), rtol=1e-6)
    np.testing.assert_array_equal(vertex["rot_0"], cloud.rotation[:, 0])
    np.testing.assert_array_equal(vertex["nz"], 0)


def test_opacities_0_and_1_and_scale_0_stay_finite(tmp_path: Path) -> None:
    opacity = np.array([0, 1, 1e-12, 1e-7, 1e-3, 0.5, 0.999, np.nextafter(np.float32(1), np.float32(0))], np.float32)
    cloud = random_cloud(len(opacity), 0)
    cloud.opacity[:] = opacity
    cloud.scale[:] = np.array([0.0, 1e-45, 3e38], np.float32)
    write_splats(tmp_path / "out.ply", cloud)
    vertex = plyfile.PlyData.read(tmp_path / "out.ply")["vertex"]
    assert all(np.isfinite(vertex[name]).all() for name in splat_properties(0))
    loaded = read_splats(tmp_path / "out.ply")
    assert loaded.dropped == 0
    assert np.abs(loaded.cloud.opacity.astype(np.float64) - opacity).max() < 1e-6
    assert loaded.cloud.opacity[1] == 1.0
    assert loaded.cloud.scale[:, :2].max() < 1.3e-38
    np.testing.assert_allclose(loaded.cloud.scale[:, 2], 3e38, rtol=1e-5)


def test_an_old_file_is_replaced_and_its_neighbours_stay(tmp_path: Path) -> None:
    (tmp_path / "out.ply").write_bytes(b"old")
    (tmp_path / "other").write_bytes(b"other")
    write_splats(tmp_path / "out.ply", random_cloud(3, 0))
    assert sorted(path.name for path in tmp_path.iterdir()) == ["other", "out.ply"]
    assert read_splats(tmp_path / "out.ply").cloud.splat_count == 3


@pytest.mark.parametrize("error", [RuntimeError, KeyboardInterrupt])
def test_an_interrupted_write_leaves_the_old_file(tmp_path: Path, error: type[BaseException]) -> None:
    path = tmp_path / "out.ply"
    path.write_bytes(b"old")
    with pytest.raises(error), replacing(path) as file:
        file.write(b"half of the new one")
        raise error
    assert [entry.name for entry in tmp_path.iterdir()] == ["out.ply"]
    assert path.read_bytes() == b"old"


def test_several_files_take_their_places_together(tmp_path: Path) -> None:
    one, two = tmp_path / "one.ply", tmp_path / "two.ply"
    one.write_bytes(b"old")
    with replacing_together() as place:
        write_splats(one, random_cloud(3, 0), place)
        write_splats(two, random_cloud(4, 0), place)
        assert one.read_bytes() == b"old" and not two.exists()
    assert [read_splats(path).cloud.splat_count for path in (one, two)] == [3, 4]
    two.unlink()
    two.mkdir()
    before = one.read_bytes()
    with pytest.raises(StippleError, match="this is a folder"), replacing_together() as place:
        write_splats(one, random_cloud(5, 0), place)
        write_splats(two, random_cloud(6, 0), place)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["one.ply", "two.ply"]
    assert one.read_bytes() == before


def test_a_full_disk_leaves_the_old_file(tmp_path: Path) -> None:
    resource = pytest.importorskip("resource", reason="no limits on file size")
    path = tmp_path / "out.ply"
    path.write_bytes(b"old")
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1_000_000, limits[1]))
    try:
        with pytest.raises(StippleError, match=r"out\.ply: it cannot be written"):
            write_splats(path, random_cloud(20_000, 3))
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert [entry.name for entry in tmp_path.iterdir()] == ["out.ply"]
    assert path.read_bytes() == b"old"


@pytest.mark.skipif(not hasattr(os, "umask"), reason="no POSIX permissions")
def test_the_file_gets_the_usual_mode_and_links_stay(tmp_path: Path) -> None:
    (tmp_path / "plain").write_bytes(b"")
    (tmp_path / "link.ply").symlink_to(tmp_path / "out.ply")
    write_splats(tmp_path / "link.ply", random_cloud(3, 0))
    assert (tmp_path / "link.ply").is_symlink()
    assert (tmp_path / "out.ply").stat().st_mode == (tmp_path / "plain").stat().st_mode


def test_where_nothing_can_be_written(tmp_path: Path) -> None:
    cloud = random_cloud(3, 0)
    (tmp_path / "folder.ply").mkdir()
    with pytest.raises(StippleError, match="this is a folder"):
        write_splats(tmp_path / "folder.ply", cloud)
    with pytest.raises(StippleError, match=r"none does not exist; make it first"):
        write_splats(tmp_path / "none" / "out.ply", cloud)
    with pytest.raises(StippleError, match=r"suffix '\.obj' is not known; splats can be written as \.ply"):
        write_splats(tmp_path / "out.obj", cloud)
    assert [entry.name for entry in tmp_path.iterdir()] == ["folder.ply"]
