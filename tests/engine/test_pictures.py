# SPDX-License-Identifier: GPL-3.0-or-later
"""Picture files, read back with the libraries other programs use."""

from __future__ import annotations

import os
import sys
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest

from stipple.engine.colour import linear_from_srgb
from stipple.engine.errors import StippleError
from stipple.engine.film import Picture
from stipple.engine.pictures import DEPTH_EMPTY, check_writable, write_picture

HEIGHT, WIDTH = 5, 7


def picture(transparent: bool = True) -> Picture:
    """Every pixel different; an empty corner where the film is transparent, and a highlight above 1."""
    rng = np.random.default_rng(11)
    alpha = rng.uniform(0.1, 1.0, (HEIGHT, WIDTH, 1)) if transparent else np.ones((HEIGHT, WIDTH, 1))
    rgba = np.concatenate([rng.uniform(0, 1, (HEIGHT, WIDTH, 3)) * alpha, alpha], axis=-1).astype(np.float32)
    depth = rng.uniform(1, 9, (HEIGHT, WIDTH)).astype(np.float32)
    rgba[1, 2, :3] = 1.5 * alpha[1, 2]
    if transparent:
        rgba[0, 0], depth[0, 0] = 0, np.inf
    return Picture(rgba=rgba, depth=depth, samples=1)


def straight(rgba: npt.NDArray[np.float32]) -> npt.NDArray[np.float64]:
    """(H, W, 3) colour in float64; 0 where there is no coverage."""
    colour, alpha = rgba[..., :3].astype(np.float64), rgba[..., 3:].astype(np.float64)
    return np.divide(colour, alpha, out=np.zeros_like(colour), where=alpha > 0)


def test_png_holds_straight_alpha(tmp_path: Path) -> None:
    image_module = pytest.importorskip("PIL.Image")
    made = picture()
    write_picture(tmp_path / "a.png", made)
    with image_module.open(tmp_path / "a.png") as image:
        assert (image.mode, image.size) == ("RGBA", (WIDTH, HEIGHT))
        pixels = np.asarray(image)
    colour = np.clip(straight(made.rgba), 0, 1) * 255
    # Half a level, and what float32 loses in the division.
    assert np.abs(pixels[..., :3] - colour).max() <= 0.5001
    assert np.abs(pixels[..., 3] - made.rgba[..., 3] * 255.0).max() <= 0.5001
    assert pixels[0, 0].tolist() == [0, 0, 0, 0] and pixels[1, 2, 0] == 255


def test_png_of_an_opaque_picture_has_no_alpha(tmp_path: Path) -> None:
    image_module = pytest.importorskip("PIL.Image")
    made = picture(transparent=False)
    write_picture(tmp_path / "a.png", made)
    write_picture(tmp_path / "b.png", made, opaque=False)
    with image_module.open(tmp_path / "a.png") as rgb, image_module.open(tmp_path / "b.png") as rgba:
        assert (rgb.mode, rgba.mode) == ("RGB", "RGBA")
        np.testing.assert_array_equal(np.asarray(rgb), np.asarray(rgba)[..., :3])
        assert np.abs(np.asarray(rgb) - np.clip(made.rgba[..., :3], 0, 1) * 255).max() <= 0.5001


def test_exr_is_premultiplied_scene_linear_with_depth(tmp_path: Path) -> None:
    openexr = pytest.importorskip("OpenEXR")
    made = picture()
    write_picture(tmp_path / "a.exr", made)
    with openexr.File(str(tmp_path / "a.exr"), separate_channels=True) as file:
        channels = {name: np.array(channel.pixels) for name, channel in file.channels().items()}
        chromaticities = file.header()["chromaticities"]
    assert set(channels) == {"R", "G", "B", "A", "Depth.Z"}
    assert {array.dtype for array in channels.values()} == {np.dtype(np.float32)}
    light = linear_from_srgb(straight(made.rgba)) * made.rgba[..., 3:]
    for index, name in enumerate("RGB"):
        np.testing.assert_allclose(channels[name], light[..., index], rtol=2e-6, atol=1e-9)
    assert channels["R"][1, 2] > made.rgba[1, 2, 3]  # the highlight is kept
    np.testing.assert_array_equal(channels["A"], made.rgba[..., 3])
    seen = np.isfinite(made.depth)
    np.testing.assert_array_equal(channels["Depth.Z"][seen], made.depth[seen])
    assert (channels["Depth.Z"][~seen] == np.float32(DEPTH_EMPTY)).all() and not seen.all()
    np.testing.assert_allclose(chromaticities, (0.64, 0.33, 0.3, 0.6, 0.15, 0.06, 0.3127, 0.329), atol=1e-6)


@pytest.mark.parametrize("name", ["a.npy", "a.NPY"])
def test_npy_is_the_blend_space_unchanged(tmp_path: Path, name: str) -> None:
    made = picture()
    write_picture(tmp_path / name, made)
    read = np.load(tmp_path / name)
    assert read.dtype == np.float32 and read.flags.c_contiguous
    np.testing.assert_array_equal(read, made.rgba)
    assert [path.name for path in tmp_path.iterdir()] == [name]


def test_folders_are_made_and_files_replaced(tmp_path: Path) -> None:
    path = tmp_path / "shots" / "one" / "a.npy"
    write_picture(path, picture(transparent=False))
    write_picture(path, picture())
    np.testing.assert_array_equal(np.load(path), picture().rgba)


@pytest.mark.parametrize("name", ["a.jpg", "a", "a.png.bak"])
def test_unknown_suffixes_are_refused(tmp_path: Path, name: str) -> None:
    with pytest.raises(StippleError, match=r"is not a picture format; choose \.png, \.exr, \.npy"):
        write_picture(tmp_path / name, picture())


def test_places_that_cannot_be_written(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    (tmp_path / "folder.npy").mkdir()
    for path in (tmp_path / "file" / "a.npy", tmp_path / "folder.npy"):
        with pytest.raises(StippleError, match="folder"):
            check_writable(path)
        with pytest.raises(StippleError, match="folder"):
            write_picture(path, picture())


@pytest.mark.parametrize(("suffix", "library"), [(".png", "PIL.Image"), (".npy", "numpy"), (".exr", "OpenEXR")])
def test_a_failed_write_leaves_the_old_file(tmp_path: Path, suffix: str, library: str) -> None:
    """A limit on the size of files stands for a full disk: the system refuses the write itself."""
    pytest.importorskip(library)
    resource = pytest.importorskip("resource")
    path = tmp_path / f"a{suffix}"
    path.write_bytes(b"old")
    rng = np.random.default_rng(0)
    noise = rng.random((200, 200, 4)).astype(np.float32)
    big = Picture(rgba=noise, depth=noise[..., 0], samples=1)
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (4096, before[1]))
    try:
        with pytest.raises(StippleError, match="cannot be written"):
            write_picture(path, big)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert path.read_bytes() == b"old"
    assert os.listdir(tmp_path) == [path.name]


@pytest.mark.parametrize(("suffix", "module"), [(".png", "PIL.Image"), (".exr", "OpenEXR")])
def test_a_missing_library_is_named(tmp_path: Path, suffix: str, module: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, module, None)  # what Python does for a module that cannot be imported
    with pytest.raises(StippleError, match=r"needs the Python package \w+; install it"):
        write_picture(tmp_path / f"a{suffix}", picture())
    assert list(tmp_path.iterdir()) == []
