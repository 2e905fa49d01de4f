# SPDX-License-Identifier: GPL-3.0-or-later
"""Camera files: which way the axes point, checked by projecting points whose place in the picture is known."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from stipple.engine.camera import INRIA_NEAR, Camera, look_at
from stipple.engine.errors import StippleError
from stipple.engine.formats import read_splats
from stipple.engine.formats.cameras_file import read_camera_file, read_cameras

INRIA_ENTRY = {
    "id": 0,
    "img_name": "front",
    "width": 200,
    "height": 100,
    "position": [0, 0, -5],
    "rotation": [[1, 0, 0], [0, 1, 0], [0, 0, 1]],
    "fx": 100.0,
    "fy": 110.0,
}
NERFSTUDIO = {
    "w": 200,
    "h": 100,
    "fl_x": 100.0,
    "fl_y": 110.0,
    "cx": 103.0,
    "cy": 48.0,
    "frames": [
        {"file_path": "a.png", "transform_matrix": [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 5], [0, 0, 0, 1]]},
    ],
}


def written(tmp_path: Path, document: Any) -> Path:
    path = tmp_path / "views.json"
    path.write_text(json.dumps(document))
    return path


def test_inria_axes(tmp_path: Path) -> None:
    """Five units before the origin, looking along +z: x goes right and y down."""
    (camera,) = read_cameras(written(tmp_path, [INRIA_ENTRY]))
    np.testing.assert_allclose(
        camera.project([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 5]]),
        [[100, 50, 5], [120, 50, 5], [100, 72, 5], [100, 50, 10]],
    )
    assert (camera.width, camera.height, camera.near) == (200, 100, INRIA_NEAR)


def test_inria_rotation_is_world_from_camera(tmp_path: Path) -> None:
    """Its third column is where the camera looks: from the origin along +x here."""
    entry = INRIA_ENTRY | {"position": [0, 0, 0], "rotation": [[0, 0, 1], [0, 1, 0], [-1, 0, 0]]}
    (camera,) = read_cameras(written(tmp_path, [entry]))
    np.testing.assert_allclose(camera.project([[4, 0, 0], [4, 0, -1]]), [[100, 50, 4], [125, 50, 4]], atol=1e-12)


def test_nerfstudio_axes(tmp_path: Path) -> None:
    """OpenGL's camera at z = 5 looks along −z: x goes right, y up; the principal point is the file's."""
    (camera,) = read_cameras(written(tmp_path, NERFSTUDIO))
    np.testing.assert_allclose(
        camera.project([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, -5]]),
        [[103, 48, 5], [123, 48, 5], [103, 26, 5], [103, 48, 10]],
    )


@pytest.mark.parametrize("seed", range(4))
def test_both_layouts_describe_the_same_camera(tmp_path: Path, seed: int) -> None:
    rng = np.random.default_rng(seed)
    wanted = Camera(look_at(rng.normal(size=3) * 4, rng.normal(size=3)), 320, 240, 300, 310, 160, 120)
    world_from_camera = np.linalg.inv(np.vstack([wanted.camera_from_world, [0, 0, 0, 1]]))
    inria = INRIA_ENTRY | {
        "width": 320,
        "height": 240,
        "fx": 300,
        "fy": 310,
        "position": world_from_camera[:3, 3].tolist(),
        "rotation": world_from_camera[:3, :3].tolist(),
    }
    world_from_gl = (world_from_camera @ np.diag([1, -1, -1, 1])).tolist()
    nerfstudio = {"w": 320, "h": 240, "fl_x": 300, "fl_y": 310, "frames": [{"transform_matrix": world_from_gl}]}
    points = rng.normal(size=(20, 3))
    for document in ([inria], nerfstudio):
        (camera,) = read_cameras(written(tmp_path, document))
        np.testing.assert_allclose(camera.project(points), wanted.project(points), rtol=1e-9)
        np.testing.assert_allclose(camera.position, wanted.position, atol=1e-12)


def test_nerfstudio_frames_override_the_file(tmp_path: Path) -> None:
    frame = NERFSTUDIO["frames"][0] | {"fl_x": 400, "w": 220}
    first, second = read_cameras(written(tmp_path, NERFSTUDIO | {"frames": [frame, *NERFSTUDIO["frames"]]}))
    assert (first.fx, first.fy, first.width) == (400, 110, 220)
    assert (second.fx, second.fy, second.width) == (100, 110, 200)


def test_nerfstudio_field_of_view(tmp_path: Path) -> None:
    document = {"w": 200, "h": 100, "camera_angle_x": np.pi / 2, "frames": NERFSTUDIO["frames"]}
    (camera,) = read_cameras(written(tmp_path, document))
    np.testing.assert_allclose([camera.fx, camera.fy, camera.cx, camera.cy], [100, 100, 100, 50])
    (camera,) = read_cameras(written(tmp_path, document | {"camera_angle_y": np.pi / 3}))
    assert camera.fy == pytest.approx(50 / np.tan(np.pi / 6))


def test_applied_transform_is_not_applied_again(tmp_path: Path) -> None:
    (plain,) = read_cameras(written(tmp_path, NERFSTUDIO))
    turned = NERFSTUDIO | {"applied_transform": [[0, 1, 0, 0], [1, 0, 0, 0], [0, 0, -1, 0]]}
    (camera,) = read_cameras(written(tmp_path, turned))
    np.testing.assert_array_equal(camera.camera_from_world, plain.camera_from_world)


def test_distortion_is_left_out_with_one_warning(tmp_path: Path) -> None:
    document = NERFSTUDIO | {"k1": 0.1, "k2": 0.0, "p1": -0.01, "frames": NERFSTUDIO["frames"] * 3}
    file = read_camera_file(written(tmp_path, document))
    assert len(file.cameras) == 3
    assert len(file.warnings) == 1
    assert "(k1, p1) is ignored" in file.warnings[0] and "views.json" in file.warnings[0]
    assert read_camera_file(written(tmp_path, NERFSTUDIO)).warnings == ()


def test_null_counts_as_missing(tmp_path: Path) -> None:
    document = NERFSTUDIO | {"k1": None, "cx": None, "cy": None}
    file = read_camera_file(written(tmp_path, document))
    assert file.warnings == () and (file.cameras[0].cx, file.cameras[0].cy) == (100, 50)
    frame = NERFSTUDIO["frames"][0] | {"fl_x": None}
    assert read_cameras(written(tmp_path, NERFSTUDIO | {"frames": [frame]}))[0].fx == 100.0
    with pytest.raises(StippleError, match="camera 0: transform_matrix is missing"):
        read_cameras(written(tmp_path, NERFSTUDIO | {"frames": [{"transform_matrix": None}]}))


@pytest.mark.parametrize("suffix", ["png", "jpg"])
def test_without_a_size_it_is_the_images(tmp_path: Path, suffix: str) -> None:
    """NeRF's synthetic scenes: a field of view, and images without a suffix in a folder beside the file."""
    image = pytest.importorskip("PIL.Image")
    (tmp_path / "train").mkdir()
    image.new("RGB", (80, 60)).save(tmp_path / "train" / f"r_0.{suffix}")
    frame = NERFSTUDIO["frames"][0] | {"file_path": "./train/r_0", "rotation": 0.01}
    document = {"camera_angle_x": 2 * np.arctan(0.5), "frames": [frame]}
    (camera,) = read_cameras(written(tmp_path, document))
    assert (camera.width, camera.height, camera.cx, camera.cy) == (80, 60, 40, 30)
    assert camera.fx == camera.fy == pytest.approx(80)
    with pytest.raises(StippleError, match=r"views\.json: camera 0: h is missing"):
        read_cameras(written(tmp_path, document | {"w": 80}))
    path = tmp_path / "train" / f"r_0.{suffix}"
    path.write_bytes(path.read_bytes()[:20])
    with pytest.raises(StippleError, match=r"r_0\.\w+: the image is damaged; copy it again"):
        read_cameras(written(tmp_path, document))
    path.write_bytes(b"BM")
    with pytest.raises(StippleError, match="neither PNG nor JPEG"):
        read_cameras(written(tmp_path, document))
    path.unlink()
    with pytest.raises(StippleError, match="camera 0: w and h are missing, and so is the image"):
        read_cameras(written(tmp_path, document))


def test_names_and_index(tmp_path: Path) -> None:
    file = read_camera_file(written(tmp_path, [INRIA_ENTRY, INRIA_ENTRY | {"img_name": "back", "fx": 50}]))
    assert file.names == ("front", "back")
    assert file.camera(1).fx == 50
    for index in (2, -1):
        with pytest.raises(StippleError, match=r"views\.json: there is no camera -?\d; choose 0 to 1"):
            file.camera(index)


def inria(change: Callable[[dict[str, Any]], Any]) -> list[Any]:
    entry = dict(INRIA_ENTRY)
    change(entry)
    return [INRIA_ENTRY, entry]


BAD_DOCUMENTS = {
    "a list of numbers": ([1, 2], "camera 0 is not an object"),
    "another object": ({"cameras": []}, "not a camera file"),
    "text": ("frames", "not a camera file"),
    "no cameras": ([], "no cameras in it"),
    "missing key": (inria(lambda entry: entry.pop("fx")), "camera 1: fx is missing"),
    "missing rotation": (inria(lambda entry: entry.pop("rotation")), "camera 1: rotation is missing"),
    "text for a number": (inria(lambda entry: entry.update(fy="wide")), "camera 1: fy is 'wide'"),
    "negative focal length": (inria(lambda entry: entry.update(fy=-3)), "fy is -3; give a number above 0"),
    "infinite focal length": (inria(lambda entry: entry.update(fx=float("inf"))), "fx is inf; give a finite"),
    "half a pixel": (inria(lambda entry: entry.update(width=20.5)), "width is 20.5; give a whole number"),
    "true as a number": (inria(lambda entry: entry.update(height=True)), "height is True"),
    "short position": (inria(lambda entry: entry.update(position=[0, 1])), "position must be 3 finite numbers"),
    "ragged rotation": (inria(lambda entry: entry.update(rotation=[[1, 0], [0]])), "rotation must be 3×3 finite"),
    "NaN position": (inria(lambda entry: entry.update(position=[0, 0, float("nan")])), "position must be"),
    "mirror": (inria(lambda entry: entry.update(rotation=[[-1, 0, 0], [0, 1, 0], [0, 0, 1]])), "not a rotation"),
    "scale": (inria(lambda entry: entry.update(rotation=[[2, 0, 0], [0, 2, 0], [0, 0, 2]])), "not a rotation"),
    "no frames": (NERFSTUDIO | {"frames": []}, "no cameras in it"),
    "no size": ({key: value for key, value in NERFSTUDIO.items() if key != "w"}, "camera 0: w is missing"),
    "no lens": ({"w": 4, "h": 4, "frames": NERFSTUDIO["frames"]}, "fl_x and camera_angle_x are both missing"),
    "no pose": (NERFSTUDIO | {"frames": [{}]}, "transform_matrix is missing"),
    "flat pose": (NERFSTUDIO | {"frames": [{"transform_matrix": [0] * 16}]}, "must be 4×4 or 3×4 finite numbers"),
    "fisheye": (NERFSTUDIO | {"camera_model": "OPENCV_FISHEYE"}, "'OPENCV_FISHEYE'; undistort the images"),
    "too wide": ({"w": 4, "h": 4, "camera_angle_x": 3.2, "frames": NERFSTUDIO["frames"]}, "view below pi"),
}


@pytest.mark.parametrize("case", BAD_DOCUMENTS)
def test_bad_files_get_one_sentence(tmp_path: Path, case: str) -> None:
    document, words = BAD_DOCUMENTS[case]
    with pytest.raises(StippleError) as caught:
        read_cameras(written(tmp_path, document))
    message = str(caught.value)
    assert words in message and "views.json" in message
    assert "\n" not in message and len(message) < 400


def test_files_that_are_no_json(tmp_path: Path) -> None:
    for name, content in (("text.json", b"[{"), ("binary.json", b"\xff\xfe\x00\x01"), ("deep.json", b"[" * 200_000)):
        (tmp_path / name).write_bytes(content)
        with pytest.raises(StippleError, match="not valid JSON"):
            read_cameras(tmp_path / name)
    with pytest.raises(StippleError, match="no such file"):
        read_cameras(tmp_path / "absent.json")


@pytest.mark.real
@pytest.mark.parametrize("name", ["koala", "rubber_toy_cloud"])
def test_a_real_capture_is_in_the_middle(shared_data: Path, name: str) -> None:
    """Most splats of every view in the frame, before the camera, and around its middle."""
    positions = read_splats(shared_data / "real" / f"{name}.ply").cloud.position
    cameras = read_cameras(shared_data / "real" / f"{name}_cameras.json")
    assert len(cameras) == 8
    for camera in cameras:
        x, y, z = camera.project(positions).T
        assert (z > camera.near).all()
        assert np.mean((x > 0) & (x < camera.width) & (y > 0) & (y < camera.height)) > 0.9
        assert abs(np.median(x) - camera.cx) < 0.12 * camera.width
        assert abs(np.median(y) - camera.cy) < 0.2 * camera.height
