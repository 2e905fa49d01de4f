# SPDX-License-Identifier: GPL-3.0-or-later
"""From an evaluated depsgraph to what the engine renders: Scene and Settings, plain values without bpy references."""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import replace
from typing import Any

import bpy
import numpy as np

from ..engine.colour import display_from_scene_linear
from ..engine.scene import Instance, Scene
from ..engine.settings import Settings
from .residency import CloudCache, Entry, EvaluatedClouds
from .splat_data import POINT_TYPES, is_capture, splat_count_of

ALL_SH_DEGREES = 4
SHOWN_TYPES = ("show_object_viewport_pointcloud", "show_object_viewport_mesh")
DEVICE = {"AUTO": "auto", "CPU": "cpu", "CUDA": "cuda:0"}


def scene_from_depsgraph(depsgraph: Any, cache: CloudCache) -> tuple[Scene, tuple[str, ...]]:
    """Every visible capture of the depsgraph's view layer, and warnings about splats left out.

    Reads `object_instances`, so collection instances, Geometry Nodes instances and duplicators count, each with its
    own matrix. What is hidden from renders is not in a render's depsgraph; what is hidden from the camera (*Ray
    Visibility*) and instances squashed to nothing are skipped. Raises StippleError for a capture with broken
    attributes.
    """
    with cache.reading(keep=sum(b_layer.use for b_layer in depsgraph.scene.view_layers) or 1):
        instances, warnings = _instances(
            depsgraph, lambda b_instance, b_object: cache.cloud_of(b_object.data, b_object.name)
        )
    return Scene(instances, background_of(depsgraph.scene)), warnings


def viewport_instances(
    depsgraph: Any, b_space: Any, known: EvaluatedClouds, changed: Collection[int]
) -> tuple[tuple[Instance, ...], tuple[str, ...]]:
    """As `scene_from_depsgraph` for what one viewport shows: local view and the viewport's object types count.

    Reads again only captures that are new or whose geometry is in `changed` (session_uids).
    """

    def cloud_of(b_instance: Any, b_object: Any) -> Entry:
        b_shown = b_instance.parent if b_instance.is_instance else b_object
        uids = [b_id.original.session_uid for b_id in (b_object.data, b_object, b_shown)]
        if not b_shown.visible_in_viewport_get(b_space):
            known.keep(b_object.data, uids)
            return None, 0
        return known.cloud_of(b_object.data, b_object.name, uids)

    with known.reading(changed):
        return _instances(depsgraph, cloud_of)


def visibility_of(b_space: Any) -> tuple[object, ...]:
    """What a 3D view shows or hides by itself, without telling the depsgraph."""
    shown = (getattr(b_space, name, None) for name in SHOWN_TYPES)
    return (b_space.local_view is not None, b_space.use_local_collections, *shown)


def changed_geometry(depsgraph: Any) -> set[int]:
    """The session_uids of what the depsgraph's last update gave new geometry."""
    return {b_update.id.original.session_uid for b_update in depsgraph.updates if b_update.is_updated_geometry}


def _instances(depsgraph: Any, cloud_of: Callable[[Any, Any], Entry]) -> tuple[tuple[Instance, ...], tuple[str, ...]]:
    instances: list[Instance] = []
    warnings: dict[str, None] = {}
    for b_instance in depsgraph.object_instances:
        b_object = b_instance.object
        if not _is_visible_capture(b_instance, b_object):
            continue
        matrix = np.array(b_instance.matrix_world, dtype=np.float64)[:3]
        if not np.isfinite(matrix).all() or np.linalg.matrix_rank(matrix[:, :3]) < 2:
            continue
        cloud, dropped = cloud_of(b_instance, b_object)
        if dropped:
            warnings[f"{b_object.name}: {dropped} splats have invalid values and are not rendered."] = None
        if cloud is not None:
            instances.append(Instance(cloud, matrix, b_object.name, b_object.pass_index))
    return tuple(instances), tuple(warnings)


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


def background_of(b_scene: Any) -> tuple[float, float, float] | None:
    """The world's colour, sRGB-encoded as the engine blends; None with *Film > Transparent*.

    Takes color × strength of the Background node at the world output (the one World properties show); what is
    linked to those two sockets is not evaluated, their own values count. A world without that node gives its viewport
    color, no world gives black.
    """
    if b_scene.render.film_transparent:
        return None
    linear = np.ones((1, 4))
    linear[0, :3] = _world_colour(b_scene.world)
    red, green, blue, _ = display_from_scene_linear(linear, working_space())[0]
    return float(red), float(green), float(blue)


def working_space() -> str:
    """The scene-linear space of the open file, as engine.colour names it; before Blender 5 always Rec.709."""
    b_colour = getattr(bpy.data, "colorspace", None)
    return str(b_colour.working_space).removeprefix("Linear ") if b_colour else "Rec.709"


def _is_visible_capture(b_instance: Any, b_object: Any) -> bool:
    if not b_instance.show_self or b_object.type not in POINT_TYPES or not b_object.visible_camera:
        return False
    return is_capture(b_object.data) and splat_count_of(b_object.data) > 0


def _world_colour(b_world: Any) -> tuple[float, float, float]:
    if b_world is None:
        return 0.0, 0.0, 0.0
    b_node = _background_node(b_world)
    if b_node is None:
        return tuple(b_world.color)
    strength = b_node.inputs["Strength"].default_value
    red, green, blue, _ = b_node.inputs["Color"].default_value
    return red * strength, green * strength, blue * strength


def _background_node(b_world: Any) -> Any:
    uses_nodes = bpy.app.version >= (5, 0, 0) or b_world.use_nodes  # from 5.0 on always, and asking is deprecated
    b_tree = b_world.node_tree if uses_nodes else None
    b_output = b_tree.get_output_node("EEVEE") if b_tree else None
    if b_output is None or not b_output.inputs["Surface"].is_linked:
        return None
    b_node = b_output.inputs["Surface"].links[0].from_node
    return b_node if b_node.type == "BACKGROUND" else None
