# SPDX-License-Identifier: GPL-3.0-or-later
"""Whatever is wrong with a file: one sentence that names the file, the property and what to do."""

from __future__ import annotations

import os
import tracemalloc
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from stipple.engine.errors import StippleError
from stipple.engine.formats import read_splats
from tests.engine.test_ply_files import ENCODINGS, Element, ply_bytes, random_columns, splat_bytes

DATA = Path(__file__).parents[3] / "shared" / "data"


def without(*names: str) -> dict[str, np.ndarray]:
    return {name: column for name, column in random_columns(4, 0).items() if name not in names}


def of(*names: str, **extra: int) -> dict[str, np.ndarray]:
    columns = random_columns(4, 0)
    return {name: columns[name] for name in names} | {name: np.full(4, value) for name, value in extra.items()}


def lists(name: str) -> bytes:
    columns = without(name)
    return ply_bytes(Element("vertex", columns, lists={name: ("uchar", "int", [[1], [2], [3], [4]])}))


def with_rest(count: int, gap: int = 0) -> bytes:
    """`count` properties f_rest_*, numbered from 0, with the first number left out where `gap` is 1."""
    columns = random_columns(4, 0) | {f"f_rest_{index + gap}": np.zeros(4) for index in range(count)}
    return splat_bytes(columns)


GOOD = splat_bytes(random_columns(4, 0))
TEXT = splat_bytes(random_columns(4, 0), encoding="ascii")
TRIANGLES = Element("face", {}, lists={"vertex_indices": ("uchar", "int", [[0, 1, 2], [1, 2, 3]])})


def swapped(old: bytes, new: bytes, content: bytes = GOOD) -> bytes:
    assert old in content
    return content.replace(old, new, 1)


CASES: dict[str, tuple[bytes, list[str]]] = {
    "mesh": (ply_bytes(Element("vertex", of("x", "y", "z", "nx", "ny", "nz")), TRIANGLES), ["a mesh", "'opacity'"]),
    "point cloud": (splat_bytes(of("x", "y", "z", red=1, green=2, blue=3)), ["a point cloud", "'opacity'"]),
    "no opacity": (splat_bytes(without("opacity")), ["lacks the vertex property 'opacity'", "export it again"]),
    "no rotation": (splat_bytes(without("rot_1", "rot_2")), ["lacks the vertex properties 'rot_1', 'rot_2'"]),
    "no position": (splat_bytes(without("y")), ["lacks the vertex property 'y'"]),
    "no vertex": (ply_bytes(Element("points", random_columns(4, 0))), ["no element 'vertex'"]),
    "compressed": (splat_bytes(of(packed_position=0, packed_color=0)), ["compressed PLY", "not supported yet"]),
    "list": (lists("opacity"), ["'opacity' is a list"]),
    "list of SH": (lists("f_dc_2"), ["'f_dc_2' is a list"]),
    "10 f_rest": (with_rest(10), ["10 properties 'f_rest_*'", "0, 9, 24, 45 or 72"]),
    "gap in f_rest": (with_rest(9, gap=1), ["'f_rest_0' is missing"]),
    "no splats": (splat_bytes({name: column[:0] for name, column in random_columns(4, 0).items()}), ["zero splats"]),
    "truncated": (GOOD[:-1], ["truncated", "4 rows of element 'vertex'", "room for 3"]),
    "only a header": (GOOD[: GOOD.index(b"end_header") + 11], ["truncated", "room for 0"]),
    "truncated later": (ply_bytes(Element("vertex", of(*without())), Element("z", of("x")))[:-1], ["element 'z'"]),
    "truncated list": (ply_bytes(TRIANGLES, Element("vertex", without()))[:-1], ["truncated"]),
    "truncated ascii": (TEXT[: TEXT.rindex(b"\n", 0, -1) + 1], ["truncated", "room for 3"]),
    "ascii cut in a row": (TEXT[: TEXT.rindex(b" ")], ["row 3 of element 'vertex' has 16 values instead of 17"]),
    "ascii extra value": (TEXT[:-1] + b" 7\n", ["row 3", "18 values instead of 17"]),
    "ascii not a number": (TEXT[: TEXT.rindex(b" ")] + b" abc\n", ["row 3", "'rot_3' is 'abc', not a number"]),
    "ascii no room": (TEXT[: TEXT.index(b"end_header") + 21], ["truncated", "room for 0"]),
    "huge": (swapped(b"vertex 4", b"vertex 4000000000000"), ["truncated", "4,000,000,000,000 rows"]),
    "huge ascii": (swapped(b"vertex 4", b"vertex 4000000000000", TEXT), ["truncated"]),
    "huge list": (swapped(b"face 2", b"face 2000000000000", ply_bytes(TRIANGLES, Element("vertex", of(*without())))),
                  ["truncated", "element 'face'"]),
    "20 digits": (swapped(b"vertex 4", b"vertex " + b"9" * 20), ["no valid count", "element vertex 999"]),
    "negative": (swapped(b"vertex 4", b"vertex -4"), ["'element vertex -4' has no valid count"]),
    "count not a number": (swapped(b"vertex 4", b"vertex four"), ["'element vertex four' has no valid count"]),
    "twice": (swapped(b"property float nx", b"property float x"), ["property 'x' is there twice"]),
    "vertex twice": (ply_bytes(Element("vertex", without()), Element("vertex", without())), ["two elements"]),
    "unknown type": (swapped(b"float nx", b"int64 nx"), ["header is not valid", "int64"]),
    "unknown encoding": (swapped(b"binary_little", b"binary_middle"), ["header is not valid", "binary_middle"]),
    "unknown keyword": (swapped(b"property float nx", b"propertie float nx"), ["header is not valid"]),
    "not ascii": (swapped(b"float nx", "float né".encode()), ["header is not valid"]),
    "no end_header": (swapped(b"end_header\n", b"end_headr\n"), ["no line 'end_header'"]),
    "end_header missing": (b"ply\nformat ascii 1.0\n", ["no line 'end_header'"]),
    "not PLY": (b"\x00\x01\x02 nothing of the kind", ["not a PLY file"]),
    "almost PLY": (b"plywood\nboards\n", ["not a PLY file"]),
    "empty": (b"", ["is empty"]),
}  # fmt: skip


def error_of(path: Path) -> str:
    with pytest.raises(StippleError) as caught:
        read_splats(path)
    return str(caught.value)


@pytest.mark.parametrize("case", CASES)
def test_one_clear_sentence(tmp_path: Path, case: str) -> None:
    content, fragments = CASES[case]
    path = tmp_path / "capture.ply"
    path.write_bytes(content)
    message = error_of(path)
    assert message.startswith(f"{path}: ")
    assert "\n" not in message
    assert message.endswith(".")
    assert all(fragment in message for fragment in fragments), message


@pytest.mark.parametrize("encoding", ENCODINGS)
def test_every_truncation_is_an_error(tmp_path: Path, encoding: str) -> None:
    content = splat_bytes(random_columns(2, 0), encoding=encoding)
    path = tmp_path / "capture.ply"
    # In ascii the last digits of the last number may be missing without a trace.
    end = content.rindex(b" ") if encoding == "ascii" else len(content) - 1
    for length in range(1, end, 5):
        path.write_bytes(content[:length])
        assert error_of(path).startswith(f"{path}: "), length


@pytest.mark.parametrize("seed", range(6))
def test_damaged_headers_never_give_another_exception(tmp_path: Path, seed: int) -> None:
    rng = np.random.default_rng(seed)
    path = tmp_path / "capture.ply"
    source = TEXT if seed % 2 else ply_bytes(TRIANGLES, Element("vertex", without()))
    end = source.index(b"end_header") + 11
    for _ in range(60):
        content = bytearray(source)
        for place in rng.integers(0, end, rng.integers(1, 4)):
            content[place] = rng.integers(0, 256) if rng.random() < 0.5 else ord(rng.choice(list(" \n0949lfx")))
        path.write_bytes(content)
        try:
            assert read_splats(path).cloud.splat_count > 0  # the damage hit a comment or an unused name
        except StippleError as error:
            assert "\n" not in str(error)


@pytest.mark.parametrize("encoding", ENCODINGS)
def test_a_huge_count_allocates_nothing(tmp_path: Path, encoding: str) -> None:
    path = tmp_path / "capture.ply"
    path.write_bytes(swapped(b"vertex 4", b"vertex 50000000", splat_bytes(random_columns(4, 0), encoding=encoding)))
    tracemalloc.start()
    try:
        assert "truncated" in error_of(path)
        assert tracemalloc.get_traced_memory()[1] < 20e6
    finally:
        tracemalloc.stop()


def test_missing_folder_pipe_and_unknown_suffix(tmp_path: Path) -> None:
    assert "there is no such file" in error_of(tmp_path / "none.ply")
    assert "this is a folder" in error_of(tmp_path)
    other = tmp_path / "notes.md"
    other.write_text("# Notes")
    assert error_of(other) == f"{other}: the suffix '.md' is not known; splats can be read as .ply (3DGS PLY)."
    bare = tmp_path / "notes"
    bare.write_text("# Notes")
    assert "a file without a suffix is not known" in error_of(bare)


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no named pipes")
def test_a_pipe_does_not_hang(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.ply")
    assert "not a regular file" in error_of(tmp_path / "pipe.ply")


@pytest.mark.skipif(not hasattr(os, "geteuid"), reason="no POSIX permissions")
def test_no_permission(tmp_path: Path) -> None:
    path = tmp_path / "capture.ply"
    path.write_bytes(GOOD)
    path.chmod(0)
    as_user: Callable[[int], None] = os.seteuid
    root = os.geteuid() == 0
    if root:
        as_user(65534)  # root may read everything
    try:
        message = error_of(path)
    finally:
        if root:
            as_user(0)
    assert message == f"{path}: there is no permission to read it; change the file's permissions."


@pytest.mark.real
def test_real_compressed_file() -> None:
    path = DATA / "real" / "guitar.compressed.ply"
    if not path.exists():
        pytest.skip("../shared/data is absent")
    message = error_of(path)
    assert "compressed PLY" in message
    assert "SuperSplat and export an uncompressed .ply" in message
