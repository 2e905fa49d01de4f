# SPDX-License-Identifier: GPL-3.0-or-later
"""Find the splats a camera really sees: from the visibility buffer of the method *points*.

*Points* throws each splat as opaque points and keeps, per pixel, which splat's point is nearest. A splat that owns a
pixel in any of a few samples is seen; one behind a surface is not, however transparent the surface's single splats are.
Chance decides about splats that are seen through others by a few percent; equal seeds decide equally.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
import warp as wp

from ..camera import Camera
from ..film import Film
from ..look import Look
from ..points.method import PointsFrame
from ..renderer import Renderer
from ..scene import Instance, Scene
from ..settings import Settings
from ..splats import SplatCloud
from ..timing import StageTimer
from .affine import checked
from .capture_cloud import CaptureCloud
from .editable_cloud import EditableCloud
from .mask import Mask, mask_from_hits, mask_from_numpy
from .match_screen import PLAIN
from .state import DELETED, HIDDEN


def match_visible(
    cloud: EditableCloud,
    camera: Camera,
    renderer: Renderer,
    world_from_object: npt.ArrayLike | None = None,
    others: Sequence[Instance] = (),
    samples: int = 4,
    seed: int = 0,
    look: Look = PLAIN,
) -> Mask:
    """Splats of which the camera sees some point in one of `samples` frames; `others` hide what is behind them.

    Hidden and deleted splats, and what the object's `look` crops away, neither match nor hide. `renderer` runs on the
    cloud's device. Raises StippleError when memory runs out.
    """
    shown = Instance(shown_shapes(cloud), checked(world_from_object, "world_from_object"), look=look)
    settings = Settings(method="points", samples=samples, seed=seed, sh_degree=0, storage="full")
    hits = cloud.hits()
    _mark_seen(Scene((shown, *others)), camera, renderer, settings, [hits])
    return mask_from_hits(hits, cloud.splat_count)


def match_visible_in_file(
    cloud: CaptureCloud,
    instances: tuple[Instance, ...],
    camera: Camera,
    renderer: Renderer,
    samples: int = 4,
    seed: int = 0,
) -> Mask:
    """As `match_visible`, of a capture that stays in its file; `instances` are those of its `EditedCapture`."""
    settings = Settings(method="points", samples=samples, seed=seed, sh_degree=0)
    scene = Scene(instances)
    clouds = renderer.device_clouds(scene, settings.storage, lambda fraction, text: None)
    hits = [wp.empty(on_device.splat_count, dtype=wp.uint8, device=cloud.device) for on_device in clouds]
    _mark_seen(scene, camera, renderer, settings, hits)
    seen = cloud.from_places(hits[0])
    if len(hits) > 1:
        seen[cloud.edits.changed_rows] = hits[1].numpy()
    return mask_from_numpy(seen != 0, cloud.device)


def _mark_seen(scene: Scene, camera: Camera, renderer: Renderer, settings: Settings, hits: Sequence[wp.array]) -> None:
    """Fill `hits`, one array for each of the first instances, with whether a splat was seen."""
    shot = renderer.shot(scene, camera, settings, StageTimer(renderer.device))
    frame = PointsFrame(shot)
    _, _, width, height = camera.rendered_window
    film = Film(width, height, renderer.buffers)
    for array in hits:
        array.zero_()
    for sample in range(settings.samples):
        frame.render_sample(sample, film, _go_on)
        for instance, array in enumerate(hits):
            frame.mark_seen(instance, film, array)


def shown_shapes(cloud: EditableCloud) -> SplatCloud:
    """What is shown of a cloud, as a capture of as many splats without harmonics: those not shown have no opacity.

    On a CPU it shares the cloud's memory, all but the opacity, and is valid until the next edit.
    """
    opacity = cloud.host("opacity").copy()
    opacity[(cloud.state.numpy() & np.uint32(HIDDEN | DELETED)) != 0] = 0
    return SplatCloud(
        position=cloud.host("position"),
        scale=cloud.host("scale"),
        rotation=cloud.host("rotation"),
        opacity=opacity,
        sh_dc=cloud.host("sh_dc"),
        sh_rest=np.empty((cloud.splat_count, 0, 3), np.float32),
        name=cloud.name,
    )


def _go_on() -> None:
    """Nobody cancels a click."""
