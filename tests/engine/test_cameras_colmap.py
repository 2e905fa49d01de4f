# SPDX-License-Identifier: GPL-3.0-or-later
"""COLMAP models: text and binary say the same, poses point the right way, damage becomes one sentence."""

from __future__ import annotations

import struct
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from stipple.engine.camera import INRIA_NEAR, Camera, look_at
from stipple.engine.errors import StippleError
from stipple.engine.formats.camera_images import find_images, name_without_suffix
from stipple.engine.formats.cameras_file import CameraFile, read_camera_file, read_cameras
from tests.colmap_files import Lens, View, view_of, write_binary, write_text

WRITERS = {"txt": write_text, "bin": write_binary}
PINHOLE = Lens(1, "PINHOLE", 200, 100, (100.0, 110.0, 103.0, 48.0))
FRONT = View(1, (1.0, 0.0, 0.0, 0.0), (0.0, 0.0, 5.0), 1, "front.jpg", ((1.5, 2.5, 7), (3.0, 4.0, -1)))
BACK = View(2, (0.0, 0.0, 1.0, 0.0), (0.0, 0.0, 5.0), 1, "back.jpg")

# Lines of the example in COLMAP's documentation of its text format.
DOCUMENTED_CAMERAS = (
    "# Camera list\n#   CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]\n1 SIMPLE_PINHOLE 3072 2304 2559.81 1536 1152\n"
)
DOCUMENTED_IMAGES = """# Image list with two lines of data per image:
#   IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID, NAME
#   POINTS2D[] as (X, Y, POINT3D_ID)
# Number of images: 2, mean observations per image: 2
1 0.851773 0.0165051 0.503764 -0.142941 -0.737434 1.02973 3.74354 1 P1180141.JPG
2362.39 248.498 58396 1784.7 268.254 59027 1784.7 268.254 -1
2 0.851773 0.0165051 0.503764 -0.142941 -0.737434 1.02973 3.74354 1 P1180142.JPG
1190.83 663.957 23056 1258.77 640.354 59070
"""


@pytest.mark.parametrize("kind", WRITERS)
def test_axes(tmp_path: Path, kind: str) -> None:
    """Camera-from-world: one view five units before the origin along +z, one behind it, turned half around y."""
    WRITERS[kind](tmp_path, [PINHOLE], [FRONT, BACK])
    file = read_camera_file(tmp_path)
    assert file.names == ("back.jpg", "front.jpg")  # sorted
    assert file.warnings == () and file.path == file.folder == tmp_path
    back, front = file.cameras
    np.testing.assert_allclose(
        front.project([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 5]]),
        [[103, 48, 5], [123, 48, 5], [103, 70, 5], [103, 48, 10]],
    )
    np.testing.assert_allclose(back.project([[1, 1, 0], [0, 0, 4]]), [[83, 70, 5], [103, 48, 1]], atol=1e-12)
    np.testing.assert_allclose(back.position, [0, 0, 5], atol=1e-12)
    assert (front.width, front.height, front.near) == (200, 100, INRIA_NEAR)


@pytest.mark.parametrize("kind", WRITERS)
def test_any_pose(tmp_path: Path, kind: str) -> None:
    """Rotations of every sign, through the test's own matrix-to-quaternion; quaternions need no unit length."""
    rng = np.random.default_rng(4)
    eyes, targets, ups = rng.normal(size=(3, 20, 3))
    wanted = [Camera(look_at(*pose), 200, 100, 100, 110, 103, 48) for pose in zip(4 * eyes, targets, ups, strict=True)]
    views = [view_of(index, camera, f"{index:03d}.png", length=0.5 + index / 10) for index, camera in enumerate(wanted)]
    WRITERS[kind](tmp_path, [PINHOLE], views[::-1])
    points = rng.normal(size=(30, 3))
    for camera, expected in zip(read_cameras(tmp_path), wanted, strict=True):
        np.testing.assert_allclose(camera.camera_from_world, expected.camera_from_world, atol=1e-12)
        np.testing.assert_allclose(camera.project(points), expected.project(points), rtol=1e-8)


def test_the_documented_example(tmp_path: Path) -> None:
    (tmp_path / "cameras.txt").write_text(DOCUMENTED_CAMERAS)
    (tmp_path / "images.txt").write_text(DOCUMENTED_IMAGES)
    file = read_camera_file(tmp_path)
    assert file.names == ("P1180141.JPG", "P1180142.JPG")
    camera = file.cameras[0]
    assert (camera.fx, camera.fy, camera.cx, camera.cy) == (2559.81, 2559.81, 1536, 1152)
    np.testing.assert_allclose(camera.camera_from_world[:, 3], [-0.737434, 1.02973, 3.74354])


MODELS = {
    "SIMPLE_PINHOLE": ((90.0, 101.0, 52.0), (90, 90, 101, 52), False),
    "PINHOLE": ((90.0, 91.0, 101.0, 52.0), (90, 91, 101, 52), False),
    "SIMPLE_RADIAL": ((90.0, 101.0, 52.0, 0.1), (90, 90, 101, 52), True),
    "RADIAL": ((90.0, 101.0, 52.0, 0.0, 0.1), (90, 90, 101, 52), True),
    "OPENCV": ((90.0, 91.0, 101.0, 52.0, 0.1, 0.0, 0.0, 0.0), (90, 91, 101, 52), True),
    "FULL_OPENCV": ((90.0, 91.0, 101.0, 52.0, *[0.0] * 7, 0.2), (90, 91, 101, 52), True),
}


@pytest.mark.parametrize("kind", WRITERS)
@pytest.mark.parametrize("model", MODELS)
def test_camera_models(tmp_path: Path, kind: str, model: str) -> None:
    parameters, expected, distorted = MODELS[model]
    WRITERS[kind](tmp_path, [Lens(1, model, 200, 100, parameters)], [FRONT, BACK])
    file = read_camera_file(tmp_path)
    for camera in file.cameras:
        assert (camera.fx, camera.fy, camera.cx, camera.cy) == expected
    assert len(file.warnings) == distorted
    assert not distorted or "lens distortion is ignored" in file.warnings[0]


@pytest.mark.parametrize("kind", WRITERS)
@pytest.mark.parametrize(
    ("model", "count"),
    [
        ("OPENCV_FISHEYE", 8),
        ("FOV", 5),
        ("THIN_PRISM_FISHEYE", 12),
        ("RAD_TAN_THIN_PRISM_FISHEYE", 16),
        ("EQUIRECTANGULAR", 2),
    ],
)
def test_fisheye_is_refused_where_a_view_uses_it(tmp_path: Path, kind: str, model: str, count: int) -> None:
    fisheye = Lens(2, model, 200, 100, (90.0,) * count)
    WRITERS[kind](tmp_path, [fisheye, PINHOLE], [FRONT])
    assert len(read_cameras(tmp_path)) == 1
    WRITERS[kind](tmp_path, [fisheye, PINHOLE], [FRONT, View(3, (1, 0, 0, 0), (0, 0, 0), 2, "wide.jpg")])
    assert_one_sentence(tmp_path, rf"cameras\.{kind}: .*1.*: the camera model {model} is not supported; undistort")


def test_where_a_model_is_found(tmp_path: Path) -> None:
    folder = tmp_path / "garden" / "sparse" / "0"
    write_text(folder, [PINHOLE], [FRONT])
    for path in (tmp_path / "garden", tmp_path / "garden" / "sparse", folder, folder / "images.txt"):
        file = read_camera_file(path)
        assert (len(file.cameras), file.path.resolve()) == (1, folder.resolve())
    write_binary(folder, [PINHOLE], [FRONT, BACK])
    assert len(read_cameras(folder)) == 2  # binary first
    assert len(read_cameras(folder / "cameras.bin")) == 2
    assert len(read_cameras(folder / "cameras.txt")) == 1


def test_folders_without_a_model(tmp_path: Path) -> None:
    assert_one_sentence(tmp_path, "there is no COLMAP model in this folder")
    write_text(tmp_path, [PINHOLE], [FRONT])
    (tmp_path / "images.txt").unlink()
    assert_one_sentence(tmp_path, "there is no COLMAP model in this folder")
    assert_one_sentence(tmp_path / "cameras.txt", r"images\.txt: there is no such file")
    assert_one_sentence(tmp_path / "absent", "no such file")


def assert_one_sentence(path: Path, pattern: str) -> None:
    with pytest.raises(StippleError, match=pattern) as caught:
        read_cameras(path)
    assert "\n" not in str(caught.value) and len(str(caught.value)) < 400


@pytest.mark.parametrize("file", ["cameras.bin", "images.bin"])
def test_binary_files_cut_anywhere(tmp_path: Path, file: str) -> None:
    write_binary(tmp_path, [PINHOLE, Lens(2, *MODEL_OF_TWO)], [FRONT, BACK])
    whole = (tmp_path / file).read_bytes()
    for length in range(1, len(whole)):
        (tmp_path / file).write_bytes(whole[:length])
        assert_one_sentence(tmp_path, rf"{file}: (the number of records|\w+ [12] of 2): the file ends inside it")
    (tmp_path / file).write_bytes(b"")
    assert_one_sentence(tmp_path, rf"{file}: the file is empty")
    (tmp_path / file).write_bytes(whole + b"\0")
    assert_one_sentence(tmp_path, rf"{file}: \w+ 2 of 2: 1 bytes follow")


MODEL_OF_TWO = ("SIMPLE_RADIAL", 20, 10, (9.0, 10.0, 5.0, 0.0))

BAD_TEXT: dict[str, tuple[str, Callable[[str], str], str]] = {
    "short camera": ("cameras", lambda text: "1 PINHOLE 200\n", "line 1: a camera is CAMERA_ID MODEL"),
    "a word for a number": ("cameras", lambda text: text.replace("110.0", "wide"), "line 1: a camera is"),
    "too few parameters": (
        "cameras",
        lambda text: text.replace("48.0", ""),
        "line 1: PINHOLE has 3 parameters where 4",
    ),
    "half a pixel": ("cameras", lambda text: text.replace("200", "200.5"), "line 1: a camera is"),
    "no width": ("cameras", lambda text: text.replace("200", "0"), "line 1: camera: the frame is 0×100"),
    "negative focal length": ("cameras", lambda text: text.replace("110.0", "-1"), "line 1: camera: focal length"),
    "NaN focal length": ("cameras", lambda text: text.replace("110.0", "nan"), "line 1: camera: focal length"),
    "unknown model": ("cameras", lambda text: text.replace("PINHOLE", "NEW"), "line 1: the camera model NEW is not"),
    "no lenses": ("cameras", lambda text: "# none\n", "line 1: front.jpg wants camera 1, which cameras.txt has not"),
    "no views": ("images", lambda text: "# none\n", "there are no cameras in it"),
    "no name": ("images", lambda text: text.replace("front.jpg", ""), "line 1: an image is IMAGE_ID"),
    "no pose": (
        "images",
        lambda text: text.replace("1.0 0.0 0.0 0.0", "0 0 0 0"),
        "line 1: front.jpg has no valid pose",
    ),
    "infinite pose": ("images", lambda text: text.replace("5.0", "inf"), "line 1: front.jpg has no valid pose"),
    "huge pose": ("images", lambda text: text.replace("1.0 0.0 0.0 0.0", "1e300 1e300 0 0"), "no valid pose"),
    "cut points": ("images", lambda text: text.replace(" 7 ", " "), "line 2: points are X Y POINT3D_ID each"),
    "no line of points": ("images", lambda text: text.splitlines()[0] + "\n" + text, "line 2: points are X Y"),
    "Latin-1": ("images", lambda text: text.replace("front", "fr\xfcnt"), "line 1: it is not UTF-8"),
}


@pytest.mark.parametrize("case", BAD_TEXT)
def test_bad_text_files_get_one_sentence(tmp_path: Path, case: str) -> None:
    stem, change, words = BAD_TEXT[case]
    write_text(tmp_path, [PINHOLE], [FRONT])
    path = tmp_path / f"{stem}.txt"
    changed = change(path.read_text())
    assert changed != path.read_text()
    path.write_bytes(changed.encode("latin-1"))
    assert_one_sentence(tmp_path, words)


def test_bad_binary_files_get_one_sentence(tmp_path: Path) -> None:
    write_binary(tmp_path, [PINHOLE], [FRONT])
    images, cameras = tmp_path / "images.bin", tmp_path / "cameras.bin"
    good_images, good_cameras = images.read_bytes(), cameras.read_bytes()
    cameras.write_bytes(good_cameras.replace(struct.pack("<Ii", 1, 1), struct.pack("<Ii", 1, 99)))
    assert_one_sentence(tmp_path, r"cameras\.bin: camera 1 of 1: camera model 99 is not known; undistort")
    cameras.write_bytes(good_cameras)
    for change, words in (
        (good_images.replace(b"front", b"fr\xfcnt"[:5]), "its name is not UTF-8"),
        (good_images.replace(b"front.jpg\0", b"f" * 5000), "image 1 of 1: the file ends inside it"),
        (struct.pack("<Q", 1 << 63) + good_images[8:], "image 2 of 9223372036854775808: the file ends inside it"),
        (good_images.replace(struct.pack("<Q", 2), struct.pack("<Q", 1 << 60)), "image 1 of 1: the file ends inside"),
        (
            good_images.replace(struct.pack("<I", 1) + b"front", struct.pack("<I", 9) + b"front"),
            "wants camera 9, which",
        ),
    ):
        images.write_bytes(change)
        assert_one_sentence(tmp_path, rf"images\.bin: .*{words}")


def test_text_may_begin_with_a_byte_order_mark(tmp_path: Path) -> None:
    write_text(tmp_path, [PINHOLE], [FRONT])
    wanted = read_cameras(tmp_path)[0]
    for stem in ("cameras", "images"):
        path = tmp_path / f"{stem}.txt"
        path.write_bytes(b"\xef\xbb\xbf" + path.read_bytes().replace(b"\n", b"\r\n"))
    (camera,) = read_cameras(tmp_path)
    np.testing.assert_array_equal(camera.camera_from_world, wanted.camera_from_world)
    assert (camera.fx, camera.width) == (wanted.fx, wanted.width)


def test_names_with_spaces_and_folders(tmp_path: Path) -> None:
    for write in WRITERS.values():
        write(tmp_path, [PINHOLE], [View(1, (1, 0, 0, 0), (0, 0, 5), 1, "left eye/0001 b.jpg")])
        assert read_camera_file(tmp_path).names == ("left eye/0001 b.jpg",)


def test_images_are_found(tmp_path: Path) -> None:
    """In every place at once: what is nearest wins, folders in names count, suffixes may be left out."""
    camera = Camera(look_at([0, 0, -5], [0, 0, 0]), 200, 100, 100, 110, 103, 48)
    names = (
        "a.jpg",
        "left/a.jpg",
        "b",
        "./images/c.png",
        "D.JPG",
        "e.jpg",
        "gone.jpg",
        "",
        str(tmp_path / "far" / "f.png"),
    )
    model = tmp_path / "garden" / "sparse" / "0"
    images = tmp_path / "garden" / "images"
    wanted = [
        images / "a.jpg", images / "left" / "a.jpg", images / "b.png", model / "images" / "c.png", images / "d.jpg",
        model / "e.jpg", None, None, tmp_path / "far" / "f.png",
    ]  # fmt: skip
    for path in (*wanted, images / "e.jpg", images / "b.txt"):
        if path:
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(b"any")
    found = find_images(CameraFile(model, (camera,) * len(names), names))
    assert [path and path.resolve() for path in found] == wanted


def test_short_names() -> None:
    cases = {"a/b/c.JPG": "c", "0001": "0001", "IMG.0001": "IMG.0001", "a\\b.png": "b", "x.tar.webp": "x.tar"}
    assert {name: name_without_suffix(name) for name in cases} == cases
