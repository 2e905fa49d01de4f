# SPDX-License-Identifier: GPL-3.0-or-later
"""`stipple render`: captures and cameras in, pictures out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from .capture_file import CaptureFile
from .cli_frames import OrbitOptions, View, check_choice, has_number, numbered, views_around, views_of_file
from .cli_notices import Notices
from .cli_types import CameraChoice
from .errors import StippleError
from .formats import open_splats
from .formats.cameras_file import CameraFile, read_camera_file
from .memory import byte_size, host_free_bytes
from .pictures import check_writable, write_picture
from .scene import Instance, Scene
from .settings import Settings
from .splats import SplatCloud

if TYPE_CHECKING:
    from .film import Picture
    from .renderer import Renderer


@dataclass(frozen=True)
class RenderJob:
    """What the command line asked for."""

    files: tuple[Path, ...]
    out: Path
    camera: CameraChoice | None
    orbit: OrbitOptions
    size: tuple[int, int] | None
    background: tuple[float, float, float] | None
    settings: Settings
    quiet: bool
    stream_above: int  # splats; captures of more stay in their file


def run(job: RenderJob) -> None:
    """Does the job, picture by picture; a picture that was finished stays when a later one fails.

    What can be found out in a moment (options, output, camera file) is checked before captures are read. Raises
    StippleError, click.UsageError, Cancelled or KeyboardInterrupt.
    """
    check_choice(job.out, job.camera, job.orbit.count)
    check_writable(job.out)
    camera_file = read_camera_file(job.camera.path) if job.camera else None
    file_views = _views_of_file(job, camera_file)
    notices = Notices(job.quiet)
    with notices.progress:
        notices.warn(camera_file.warnings if camera_file else ())
        clouds = _open_clouds(job, notices)
        views = file_views or views_around(_samples(clouds, notices), job.orbit, job.size)
        scene = Scene(tuple(Instance(cloud, name=cloud.name) for cloud in clouds), job.background)
        notices.start(len(views))
        renderer = _new_renderer(job.settings.device)
        try:
            for done, view in enumerate(views):
                picture = _render_view(renderer, scene, view, job, notices, done)
                path = numbered(job.out, view.number)
                write_picture(path, picture, opaque=job.background is not None)
                notices.warn(picture.stats.warnings)
                if not job.quiet:
                    print(summary(path, picture, job.settings.method), flush=True)
        finally:
            renderer.free()


def summary(path: Path, picture: Picture, method: str) -> str:
    """One line: file, size, work, time, speed, memory."""
    height, width = picture.rgba.shape[:2]
    stats = picture.stats
    unit, count = {
        "points": ("points", stats.points),
        "sorted": ("blends", stats.blends),
        "rays": ("splats", stats.splats_visible * picture.samples),
    }[method]
    samples = f"{picture.samples} sample{'s' if picture.samples != 1 else ''}"
    rate = count / max(stats.seconds, 1e-9) / 1e6
    return (
        f"{path}: {width}×{height}, {samples} in {stats.seconds:.2f} s, "
        f"{rate:.3g} M {unit}/s, peak memory {byte_size(stats.peak_bytes)}"
    )


def _views_of_file(job: RenderJob, camera_file: CameraFile | None) -> tuple[View, ...]:
    if camera_file is None or job.camera is None:
        return ()
    return views_of_file(camera_file, job.camera.index, has_number(job.out), job.size)


def _open_clouds(job: RenderJob, notices: Notices) -> list[SplatCloud | CaptureFile]:
    """Small captures in memory; of large ones the header, and a line on what they will take."""
    clouds: list[SplatCloud | CaptureFile] = []
    for file in job.files:
        source = open_splats(file)
        if source.splat_count > job.stream_above:
            capture = CaptureFile.open(file)
            size, packed = byte_size(capture.fingerprint.file_bytes), byte_size(capture.packed_bytes)
            notices.say(
                f"{file}: {capture.splat_count:,} splats, {size}, stays in its file; {packed} on the device, "
                f"{byte_size(host_free_bytes())} of memory are free"
            )
            clouds.append(capture)
            continue
        loaded = source.read(notices.report)
        notices.warn(loaded.warnings)
        clouds.append(loaded.cloud)
    return clouds


def _samples(clouds: Sequence[SplatCloud | CaptureFile], notices: Notices) -> list[SplatCloud]:
    """What the clouds are framed by; of large captures a sample, for which they are read once."""
    return [cloud if isinstance(cloud, SplatCloud) else cloud.survey(notices.report).sample for cloud in clouds]


def _render_view(renderer: Renderer, scene: Scene, view: View, job: RenderJob, notices: Notices, done: int) -> Picture:
    """One picture; the bar counts pictures, and this one's fraction moves it on."""
    prefix = f"{done + 1}/{notices.total} " if notices.total != 1 else ""

    def report(fraction: float, text: str) -> None:
        notices.report(done + fraction, f"{prefix}{text}")

    return renderer.render(scene, view.camera, job.settings, report)


def _new_renderer(device: str) -> Renderer:
    """The renderer; only now is Warp imported, which takes a second and is not needed for anything else."""
    try:
        from .renderer import Renderer
    except ModuleNotFoundError as error:
        if error.name is None or error.name.partition(".")[0] != "warp":
            raise
        raise StippleError("rendering needs the Python package warp-lang; install it with pip.") from error
    return Renderer(device)
