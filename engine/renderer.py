# SPDX-License-Identifier: GPL-3.0-or-later
"""The frame as a table of contents: scene and camera in, picture out.

upload      clouds to the device, once each
method      points: stage, rates │ sorted: stage, order, tiles │ rays: textures, order
samples     points: clear, counts, distribute, splat, resolve │ sorted: blend │ rays: draw      (repeated)
resolve     film to picture
"""

from __future__ import annotations

import time
import weakref
from collections.abc import Callable
from typing import Protocol

import numpy as np
import warp as wp

from .buffers import Buffers, allocation_limits
from .camera import Camera
from .capture_file import CaptureFile
from .capture_order import in_places
from .cloud_upload import DeviceSource, upload_any
from .device import choose_device
from .device_cloud import DeviceCloud, to_device, with_state
from .device_look import make_device_look
from .environment import BYTES_PER_PIXEL as ENVIRONMENT_BYTES
from .environment import DeviceEnvironment, look_around, upload_environment
from .film import BYTES_PER_PIXEL, Film, Finish, Light, Picture, RenderStats
from .maths.projection import make_pose, make_view
from .occlusion import OcclusionMemory
from .placements import place
from .points.method import PointsFrame
from .points.resolve import BYTES_PER_SUBPIXEL
from .progress import Progress
from .rays.host import RasterHost
from .rays.method import RaysFrame
from .rays.moderngl_device import ModernGLDevice
from .rays.uploads import RasterScene
from .reprojection import History
from .scene import Background, Environment, EnvironmentImage, Instance, Scene, SplatStates
from .settings import Settings
from .shot import Shot
from .sorted.method import SortedFrame
from .splats import SplatCloud
from .timing import StageTimer


class MethodFrame(Protocol):
    """What a method makes of a shot; `METHOD_FRAMES` holds the constructors."""

    sample_count: int
    splats_visible: int
    points: int
    warnings: tuple[str, ...]

    @property
    def blends(self) -> int: ...

    def render_sample(self, sample: int, film: Film, checkpoint: Callable[[], None]) -> None: ...


METHOD_FRAMES: dict[str, Callable[[Shot], MethodFrame]] = {
    "points": PointsFrame,
    "sorted": SortedFrame,
    "rays": RaysFrame,
}


class Renderer:
    """Renders scenes on one device and keeps its buffers and uploaded clouds from frame to frame.

    Clouds are recognised by identity and leave the device when the host drops them or they are missing from a
    scene. Not for several threads at once.
    """

    def __init__(
        self,
        device: str = "auto",
        *,
        synchronise_stages: bool = False,
        raster_host: Callable[[], RasterHost] = ModernGLDevice,
    ) -> None:
        self.device = choose_device(device)
        self.buffers = Buffers(self.device, allocation_limits.get(device))
        self._synchronise_stages = synchronise_stages
        self._raster_host = raster_host
        self._raster: RasterScene | None = None
        self._clouds: dict[tuple[int, str], tuple[weakref.ref[SplatCloud | DeviceSource], DeviceCloud]] = {}
        self._states: dict[int, tuple[SplatStates, wp.array]] = {}
        self._occlusion_memory = OcclusionMemory()
        self.history = History()
        self._environment: tuple[EnvironmentImage, DeviceEnvironment] | None = None

    def render(self, scene: Scene, camera: Camera, settings: Settings, progress: Progress | None = None) -> Picture:
        """All samples of one picture.

        Raises StippleError for what the user can mend, DeviceError among them where another device may help, and lets
        `Cancelled` through. A device that fails while it works raises Warp's RuntimeError.
        """
        frame = Frame(self, scene, camera, settings, progress)
        for sample in range(frame.sample_count):
            frame.render_sample(sample)
        return frame.resolve()

    def device_clouds(self, scene: Scene, storage: str, progress: Progress) -> list[DeviceCloud]:
        """One per instance, shared by instances of one cloud; drops those the scene no longer has."""
        clouds = {_place_of(instance, storage): instance.cloud for instance in scene.instances}
        self._clouds = {key: held for key, held in self._clouds.items() if key in clouds and held[0]() is clouds[key]}
        for key, cloud in clouds.items():
            if key not in self._clouds:
                self._clouds[key] = (weakref.ref(cloud), upload_any(cloud, self.device, key[1], progress))
        shown = [self._clouds[_place_of(instance, storage)][1] for instance in scene.instances]
        before, self._states = self._states, {}
        for i, instance in enumerate(scene.instances):
            if (states := instance.states) is not None:
                known = self._states.get(id(states)) or before.get(id(states))
                held = self._states[id(states)] = known or (states, self._upload(instance.cloud, states, progress))
                shown[i] = with_state(shown[i], held[1])
        return shown

    def _upload(self, cloud: SplatCloud | DeviceSource, states: SplatStates, progress: Progress) -> wp.array:
        """The flags in the order of the cloud on the device."""
        words = to_device(states.words, wp.uint32, self.device)
        return in_places(words, cloud, progress) if isinstance(cloud, CaptureFile) else words

    def environment(self, image: EnvironmentImage) -> DeviceEnvironment:
        """The image on the device; one is kept from frame to frame."""
        if self._environment is None or self._environment[0] is not image:
            self._environment = None  # before the new one takes memory
            self._environment = (image, upload_environment(image, self.device))
        return self._environment[1]

    def free_environment(self) -> None:
        self._environment = None

    def shot(
        self, scene: Scene, camera: Camera, settings: Settings, timer: StageTimer, progress: Progress | None = None
    ) -> Shot:
        """A scene through a camera, its clouds on the device."""
        with timer.stage("upload"):
            clouds = self.device_clouds(scene, settings.storage, progress or (lambda fraction, text: None))
        placed = [(np.asarray(i.world_from_object, np.float64), i.look) for i in scene.instances]
        poses = [make_pose(camera, matrix, make_device_look(look, matrix, settings)) for matrix, look in placed]
        return Shot(
            scene=scene,
            camera=camera,
            settings=settings,
            view=make_view(camera, settings),
            clouds=clouds,
            poses=poses,
            placements=place(clouds, poses, self.device),
            occlusion_memory=self._occlusion_memory,
            buffers=self.buffers,
            timer=timer,
            raster=self.raster,
        )

    def raster(self) -> RasterScene:
        """The graphics context of *rays* and what it holds; made on first use.

        It belongs to the thread that asks first. Raises StippleError where none can be had.
        """
        if self._raster is None:
            self._raster = RasterScene(self._raster_host())
        return self._raster

    def release_raster(self) -> None:
        """Give the graphics context of *rays* back; a host whose context ends with each frame must."""
        if self._raster is not None:
            self._raster.host.release()
            self._raster = None

    def free(self) -> None:
        """Give all device memory back. The renderer can be used again."""
        self.release_raster()
        self._clouds.clear()
        self._states.clear()
        self._occlusion_memory.forget()
        self.history.forget()
        self.free_environment()
        self.buffers.free()


def _place_of(instance: Instance, storage: str) -> tuple[int, str]:
    """Under what a renderer keeps an instance's cloud.

    Flags of what the host holds go by splats in its order, so it is not quantised then; others choose for themselves.
    """
    full = instance.states is not None or not isinstance(instance.cloud, SplatCloud)
    return id(instance.cloud), "full" if full else storage


def picture_bytes(pixels: int, settings: Settings, background: Background) -> dict[str, int]:
    """What the buffers take that grow with the picture, by name [bytes]; those that grow with splats come on top."""
    needs = {name: size * pixels for name, size in BYTES_PER_PIXEL.items()}
    if settings.method == "points":
        needs |= {name: size * pixels * settings.supersampling**2 for name, size in BYTES_PER_SUBPIXEL.items()}
    if isinstance(background, Environment):
        needs |= {name: size * pixels for name, size in ENVIRONMENT_BYTES.items()}
    return needs


class Frame:
    """One picture in progress: samples may be added and the mean looked at in any rhythm."""

    def __init__(
        self, renderer: Renderer, scene: Scene, camera: Camera, settings: Settings, progress: Progress | None = None
    ) -> None:
        self._begin = time.perf_counter()
        self._scene, self._camera, self._settings = scene, camera, settings
        self._progress, self._renderer = progress, renderer
        self._done = 0.0
        self.timer = StageTimer(renderer.device, renderer._synchronise_stages)
        buffers = renderer.buffers
        _, _, width, height = camera.rendered_window
        self.checkpoint("loading")
        shot = renderer.shot(scene, camera, settings, self.timer, progress)
        self.checkpoint("sorting")
        needs = picture_bytes(width * height, settings, scene.background)
        buffers.check(needs, f"a picture of {width}×{height} px")
        self.film = Film(width, height, buffers)
        self._behind = self._look_around(camera, settings)
        self.method = METHOD_FRAMES[settings.method](shot)
        self.sample_count = self.method.sample_count

    def _look_around(self, camera: Camera, settings: Settings) -> tuple[float, float, float] | wp.array | None:
        """The scene's background as the film takes it."""
        background = self._scene.background
        if not isinstance(background, Environment):
            self._renderer.free_environment()
            return background
        with self.timer.stage("background"):
            uploaded = self._renderer.environment(background.image)
            return look_around(background, uploaded, camera, settings.supersampling, self._renderer.buffers)

    def checkpoint(self, text: str = "rendering") -> None:
        """Tell the host how far it is; the host may raise `Cancelled` here."""
        if self._progress is not None:
            self._progress(self._done, text)

    def render_sample(self, sample: int) -> None:
        """Add one sample of the whole window. Equal sample numbers give equal samples."""
        self._done = min(1.0, self.film.samples / self.sample_count)
        self.method.render_sample(sample, self.film, self.checkpoint)
        self._done = min(1.0, self.film.samples / self.sample_count)
        self.checkpoint()

    def _reproject(self, rgba: wp.array, depth: wp.array) -> None:
        self._renderer.history.mix(rgba, depth, self._camera, self._renderer.buffers)

    def resolve(self) -> Picture:
        """The mean of the samples so far; with `reprojection` to be asked for once, as each call enters the next."""
        with self.timer.stage("film"):
            picture = self.film.resolve(self._behind, RenderStats(), self._finish)
        self._fill(picture.stats)
        return picture

    def resolve_light(self, working_space: str) -> Light:
        """As `resolve`, for hosts: light in their working space, on a CPU lent until the renderer's next picture."""
        with self.timer.stage("film"):
            light = self.film.resolve_light(self._behind, RenderStats(), working_space, self._finish)
        self._fill(light.stats)
        return light

    @property
    def _finish(self) -> Finish | None:
        return self._reproject if self._settings.reprojection else None

    def _fill(self, stats: RenderStats) -> None:
        """What is known now of the picture in progress."""
        stats.peak_bytes = self._renderer.buffers.peak_bytes
        stats.splats_visible = self.method.splats_visible
        stats.points, stats.blends = self.method.points, self.method.blends
        stats.warnings = self.method.warnings
        captures = (instance.cloud for instance in self._scene.instances if isinstance(instance.cloud, CaptureFile))
        stats.warnings += tuple(dict.fromkeys(warning for capture in captures for warning in capture.warnings))
        if self.method.splats_visible == 0 and self._scene.splat_count:
            stats.warnings += (
                f"None of the {self._scene.splat_count:,} splats can be seen: they are behind the camera, outside its "
                "clipping range or beside the picture, or fainter than 1/255.",
            )
        stats.stage_seconds = dict(self.timer.seconds)
        stats.stage_core_seconds = dict(self.timer.core_seconds)
        stats.seconds = time.perf_counter() - self._begin
