# SPDX-License-Identifier: GPL-3.0-or-later
"""From an evaluated depsgraph to what the engine renders: Scene and Settings, plain values without bpy references."""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import replace
from typing import Any, TypeVar

import numpy as np

from ..engine.capture_file import CaptureFile
from ..engine.errors import StippleError
from ..engine.scene import Instance, Scene
from ..engine.settings import Settings
from ..engine.splats import SplatCloud
from . import residency, sequence, world
from .edit.preview import Preview, preview_of
from .edit.shown import shown_in_render, shown_in_viewport
from .linked_capture import is_linked, lost_notice
from .looks import ALL_SH_DEGREES, LookReader
from .residency import CloudCache, EvaluatedClouds, linked
from .splat_data import POINT_TYPES, is_capture, splat_count_of

SHOWN_TYPES = ("show_object_viewport_pointcloud", "show_object_viewport_mesh")
DEVICE = {"AUTO": "auto", "CPU": "cpu", "CUDA": "cuda:0"}

T = TypeVar("T")
Shown = tuple[SplatCloud | CaptureFile | None, int]
"""What an object shows, and how many of its splats are left out."""


def scene_from_depsgraph(depsgraph: Any, cache: CloudCache) -> tuple[Scene, tuple[str, ...]]:
    """Every visible capture of the depsgraph's view layer, and warnings about splats left out.

    Reads `object_instances`, so collection instances, Geometry Nodes instances and duplicators count, each with its
    own matrix. What is hidden from renders is not in a render's depsgraph; what is hidden from the camera (*Ray
    Visibility*) and instances squashed to nothing are skipped. Raises StippleError for a capture with broken
    attributes and for a linked one whose file is missing: a frame without it must not pass for the right one.
    """
    player = sequence.SequencePlayer(residency.sequences)

    def cloud_of(b_instance: Any, b_object: Any) -> Shown:
        if sequence.plays(b_object):
            return player.cloud_of(b_object)
        if is_linked(b_object.data):
            return linked.capture_of(b_object.data, b_object.name), 0
        return cache.cloud_of(b_object.data, b_object.name)

    keep = sum(b_layer.use for b_layer in depsgraph.scene.view_layers) or 1
    with cache.reading(keep), player.reading(depsgraph.scene, keep):
        instances, warnings = _instances(depsgraph, cloud_of)
    world.images.look_again()
    background, notice = world.background_of(depsgraph.scene)
    return Scene(instances, background), (*warnings, *player.warnings, *([notice] if notice else []))


def viewport_instances(
    depsgraph: Any,
    b_space: Any,
    known: EvaluatedClouds,
    player: sequence.SequencePlayer,
    changed: Collection[int],
) -> tuple[tuple[Instance, ...], tuple[str, ...]]:
    """As `scene_from_depsgraph` for what one viewport shows: local view and the viewport's object types count.

    Reads again only captures that are new or whose geometry is in `changed` (session_uids). What cannot be read is left
    out, of a linked capture the proxy is shown, and a warning says so: the others stay in view while one is mended.
    """
    problems: dict[str, None] = {}
    nothing: Shown = (None, 0)

    def cloud_of(b_instance: Any, b_object: Any) -> Shown:
        b_shown = b_instance.parent if b_instance.is_instance else b_object
        b_original = b_object.original  # whose data it is: before Blender 5, evaluated data forgets its original
        uids = [b_id.session_uid for b_id in (b_original.data, b_original, b_shown.original)]
        if not b_shown.visible_in_viewport_get(b_space):
            known.keep(b_object.data, uids)
            return nothing
        if sequence.plays(b_object):
            return _tried(lambda: player.cloud_of(b_object), nothing, problems)
        if is_linked(b_object.data):
            capture = _tried(lambda: linked.capture_of(b_object.data, b_object.name), None, problems)
            if capture is not None:
                return capture, 0
        if isinstance(preview := preview_of(b_object), Preview):
            return preview.cloud, 0
        return _tried(lambda: known.cloud_of(b_object.data, b_object.name, uids), nothing, problems)

    def as_shown(instance: Instance, b_object: Any, dropped: int) -> tuple[tuple[Instance, ...], str]:
        bare: tuple[tuple[Instance, ...], str] = ((instance,), "")
        return _tried(lambda: shown_in_viewport(instance, b_object, dropped, depsgraph.scene), bare, problems)

    with known.reading(changed), player.reading(depsgraph.scene):
        instances, warnings = _instances(depsgraph, cloud_of, as_shown)
    return instances, (*problems, *warnings, *player.warnings)


def _tried(read: Callable[[], T], otherwise: T, problems: dict[str, None]) -> T:
    """What `read` gives; `otherwise`, and its sentence among the problems, where it raises StippleError."""
    try:
        return read()
    except StippleError as error:
        problems[str(error)] = None
        return otherwise


def visibility_of(b_space: Any) -> tuple[object, ...]:
    """What a 3D view shows or hides by itself, without telling the depsgraph."""
    shown = (getattr(b_space, name, None) for name in SHOWN_TYPES)
    return (b_space.local_view is not None, b_space.use_local_collections, *shown)


def changed_geometry(depsgraph: Any) -> set[int]:
    """The session_uids of what the depsgraph's last update gave new geometry."""
    return {b_update.id.original.session_uid for b_update in depsgraph.updates if b_update.is_updated_geometry}


def _instances(
    depsgraph: Any,
    cloud_of: Callable[[Any, Any], Shown],
    as_shown: Callable[[Instance, Any, int], tuple[tuple[Instance, ...], str]] = shown_in_render,
) -> tuple[tuple[Instance, ...], tuple[str, ...]]:
    instances: list[Instance] = []
    warnings: dict[str, None] = {}
    looks = LookReader(depsgraph, world.working_space())
    for b_instance in depsgraph.object_instances:
        b_object = b_instance.object
        if not _is_visible_capture(b_instance, b_object, depsgraph.view_layer):
            continue
        matrix = np.array(b_instance.matrix_world, dtype=np.float64)[:3]
        if not np.isfinite(matrix).all() or np.linalg.matrix_rank(matrix[:, :3]) < 2:
            continue
        cloud, dropped = cloud_of(b_instance, b_object)
        if dropped:
            warnings[f"{b_object.name}: {dropped} splats have invalid values and are not rendered."] = None
        if cloud is not None:
            if not sequence.plays(b_object) and (lost := lost_notice(b_object)):
                warnings[lost] = None
            instance = Instance(cloud, matrix, b_object.name, b_object.pass_index, looks.look_of(b_instance))
            if _is_held_out(b_instance, b_object, depsgraph.view_layer):
                warnings[f"{b_object.name}: it is drawn, for Stipple has no holdouts; take it out of the holdout."] = (
                    None
                )
            shown, notice = as_shown(instance, b_object, dropped)
            instances.extend(shown)
            warnings |= {notice: None} if notice else {}
    return tuple(instances), (*warnings, *looks.notices)


def settings_from_scene(b_scene: Any) -> Settings:
    """`scene.stipple` as engine Settings."""
    b_stipple = b_scene.stipple
    return Settings(
        method=b_stipple.method.lower(),
        samples=b_stipple.samples,
        supersampling=b_stipple.supersampling,
        seed=b_stipple.seed,
        device=DEVICE[b_stipple.device],
        sh_degree=None if b_stipple.sh_degree == ALL_SH_DEGREES else b_stipple.sh_degree,
        antialiased=b_stipple.antialiased,
        dilation_px2=b_stipple.dilation_px2,
        points_per_thread=b_stipple.points_per_thread,
        alpha_max=b_stipple.alpha_max,
        ray_order=b_stipple.ray_order.lower(),
        storage=b_stipple.storage.lower(),
    )


def viewport_settings(b_scene: Any) -> Settings:
    """As `settings_from_scene`, with the viewport's own number of samples."""
    return replace(settings_from_scene(b_scene), samples=b_scene.stipple.viewport_samples)


def _is_visible_capture(b_instance: Any, b_object: Any, b_view_layer: Any) -> bool:
    """Splats light nothing, so what is seen only indirectly is not seen."""
    if not b_instance.show_self or b_object.type not in POINT_TYPES or not b_object.visible_camera:
        return False
    if _shown_by(b_instance, b_object).indirect_only_get(view_layer=b_view_layer):
        return False
    return is_capture(b_object.data) and splat_count_of(b_object.data) > 0


def _is_held_out(b_instance: Any, b_object: Any, b_view_layer: Any) -> bool:
    return b_object.is_holdout or _shown_by(b_instance, b_object).holdout_get(view_layer=b_view_layer)


def _shown_by(b_instance: Any, b_object: Any) -> Any:
    """The original object that is in the view layer's collections: of instances the one that makes them."""
    return (b_instance.parent if b_instance.is_instance else b_object).original
