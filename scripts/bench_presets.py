# SPDX-License-Identifier: GPL-3.0-or-later
"""The scenes that benchmarks and their previews share, each with a camera path; declared once, in PRESETS."""

from __future__ import annotations

import shutil
import subprocess
import tempfile
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np

from stipple.engine.cloud_upload import DeviceSource
from stipple.engine.formats import read_splats
from stipple.engine.formats.cameras_file import read_cameras
from stipple.engine.scene import Instance, Scene
from stipple.engine.settings import METHODS
from stipple.engine.splats import SplatCloud
from stipple.scripts.bench_paths import CameraPath
from stipple.scripts.generated_scenes import DisplacedCopies, GeneratedCity
from stipple.scripts.generated_scenes.city_plan import PITCH, STREET_WIDTH

ROOT = Path(__file__).resolve().parent.parent
REAL = ROOT.parent / "shared" / "data" / "real"
SPLAT_TRANSFORM = "@playcanvas/splat-transform@3.7.0"
SKY = (0.66, 0.76, 0.86)  # sRGB-encoded


@dataclass(frozen=True)
class Opened:
    """A preset's scene, how the camera moves through it, and what it was made from."""

    scene: Scene
    path: CameraPath
    made_from: str

    @property
    def cloud(self) -> SplatCloud | DeviceSource:
        return self.scene.instances[0].cloud


@dataclass(frozen=True)
class Preset:
    """`open` returns None where what it needs is absent; `methods` are measured unless others are asked for."""

    text: str
    open: Callable[[], Opened | None]
    methods: tuple[str, ...] = METHODS


def _opened(cloud: SplatCloud | DeviceSource, path: CameraPath, made_from: str, background: object = None) -> Opened:
    return Opened(Scene((Instance(cloud),), background), path, made_from)  # type: ignore[arg-type]


def sample(splat_count: int) -> Opened:
    """The project's own sample, as on the README at the beginning."""
    from stipple.scripts.sample_capture import build_sample

    path = CameraPath((0.9, -1.12, -2.95), (0.03, -0.41, 0.0), (3.5, -5.0, -11.0), (0.0, -0.3, 0.0), fov_y=30.0)
    return _opened(build_sample(splat_count), path, "sample")


def koala() -> Opened | None:
    if not REAL.is_dir():
        return None
    cloud = read_splats(REAL / "koala.ply").cloud
    return _opened(cloud, _around(cloud, "koala"), "koala")


def playbot() -> Opened | None:
    cloud = _playbot_cloud()
    return None if cloud is None else _opened(cloud, _around(cloud, "playbot"), "playbot")


def _around(cloud: SplatCloud, name: str) -> CameraPath:
    """From the first camera that comes with a capture, straight away from it and upwards."""
    camera = read_cameras(REAL / f"{name}_cameras.json")[0]
    eye, forward = camera.position, camera.camera_from_world[2, :3]
    distance = float(forward @ (np.median(cloud.position, axis=0) - eye))
    target = eye + distance * forward
    far = eye - target + [0.0, -0.5 * distance, 0.0]
    fov = float(np.degrees(2 * np.arctan(0.5 * camera.height / camera.fy)))
    return CameraPath(eye, target, target + 4.0 * far, target, fov_y=fov, clip_near=camera.near)


@cache
def _playbot_cloud() -> SplatCloud | None:
    """Level 0 of the streamed capture, turned into a PLY in the temporary folder where Node.js is at hand."""
    source, npx = REAL / "playbot_sog_lod" / "0_0" / "meta.json", shutil.which("npx")
    file = Path(tempfile.gettempdir()) / "stipple-bench" / "playbot.ply"
    if not source.is_file() or (npx is None and not file.exists()):
        return None
    if not file.exists():
        file.parent.mkdir(exist_ok=True)
        part = file.with_suffix(".part.ply")
        command = [str(npx), "--yes", SPLAT_TRANSFORM, "-w", str(source), str(part)]
        if subprocess.run(command, capture_output=True, timeout=300, check=False).returncode != 0:
            return None
        part.replace(file)
    return replace(read_splats(file).cloud, name="playbot")


def city(millions: int) -> Opened:
    """From street level in the middle of the city to all of it from above."""
    source = GeneratedCity(millions * 1_000_000)
    return _opened(source, city_path(source), "city", SKY)


def city_path(source: GeneratedCity) -> CameraPath:
    """Begins in the middle of the street that is nearest to the city's."""
    half = source.half_size
    first = -half + STREET_WIDTH / 2
    street = first + PITCH * np.round(-first / PITCH)
    eye, target = (street[0] + 1.0, -1.7, street[1] - 72.0), (street[0] - 0.5, -5.0, street[1] - 30.0)
    far = np.array([-0.55, -0.75, -1.0]) * 2.2 * half.max()
    return CameraPath(eye, target, far, (0.0, 0.0, 0.0), clip_near=0.6, clip_far=1e5)


def copies(millions: int, *, harmonics: bool) -> Opened:
    """Of playbot where it can be had, else of the sample; from one of them to all."""
    one = _playbot_cloud() or sample(260_000).cloud
    assert isinstance(one, SplatCloud)
    if not harmonics:
        one = replace(one, sh_rest=np.zeros((one.splat_count, 0, 3), np.float32))
    source = DisplacedCopies(one, millions * 1_000_000)
    return _opened(source, copies_path(source), f"copies of {one.name}")


def copies_path(source: DisplacedCopies) -> CameraPath:
    centre = np.median(source.capture.position, axis=0)
    places = source.displacements
    middle = places.mean(axis=0)
    near = centre + places[np.linalg.norm(places - middle, axis=1).argmin()]
    extent = np.ptp(places, axis=0).max() + source.spacing
    return CameraPath(
        near_eye=near + source.spacing * np.array([0.5, -0.45, -1.0]),
        near_target=near,
        far_eye=centre + middle + extent * np.array([0.6, -0.9, -1.2]),
        far_target=centre + middle,
    )


def _generated() -> dict[str, Preset]:
    presets = {}
    for millions in (1, 6, 25, 106, 425):
        presets[f"city-{millions}m"] = Preset(
            f"{millions} M splats, a generated city, SH degree 0", lambda n=millions: city(n), ("points",)
        )
    for millions in (1, 6, 25, 106, 425):
        harmonics = millions <= 25
        text = "with its harmonics" if harmonics else "without harmonics"
        presets[f"copies-{millions}m"] = Preset(
            f"{millions} M splats, copies of playbot (of the sample without ../shared), {text}",
            lambda n=millions, sh=harmonics: copies(n, harmonics=sh),
            ("points",),
        )
    return presets


PRESETS: dict[str, Preset] = {
    "koala": Preset("54,804 splats, a real capture, SH degree 0 (skipped without ../shared)", koala),
    "playbot": Preset("500,000 splats, a real capture, SH degree 2 (skipped without ../shared and npx)", playbot),
    "sample": Preset("260,000 splats, the project's own sample, SH degree 3", lambda: sample(260_000)),
    "playbot-sized": Preset("500,000 splats, the same sample, denser", lambda: sample(500_000)),
    **_generated(),
}
SMALL_PRESETS = ("koala", "playbot", "sample", "playbot-sized", "city-1m")  # measured if none is asked for
LARGE_PRESETS = ("copies-1m", "copies-6m", "copies-25m")
