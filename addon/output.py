# SPDX-License-Identifier: GPL-3.0-or-later
"""From a finished picture to the passes of Blender's RenderResult."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from ..engine.film import Picture

DEPTH_OF_NOTHING = 1e10  # what Blender's own engines write where a ray hits nothing
COMBINED = "Combined"
DEPTH = "Depth"


def register_passes(b_engine: Any, b_scene: Any, b_view_layer: Any) -> None:
    """Names the passes a view layer gets, for the compositor's sockets."""
    b_engine.register_pass(b_scene, b_view_layer, COMBINED, 4, "RGBA", "COLOR")
    if b_view_layer.use_pass_z:
        b_engine.register_pass(b_scene, b_view_layer, DEPTH, 1, "Z", "VALUE")


def write_picture(b_engine: Any, picture: Picture, layer: str, view: str, working_space: str) -> None:
    """Writes Combined (premultiplied scene-linear, in the file's working space) and, where the layer has it, Depth.

    The picture has rows from the top, Blender from the bottom; its rgba is overwritten on the way.
    Depth is measured along the camera's axis [world units].
    """
    from ..engine.light import light_from_display  # Warp is loaded by whoever rendered the picture

    height, width = picture.depth.shape
    result = b_engine.begin_result(0, 0, width, height, layer=layer, view=view)
    try:
        b_passes = result.layers[0].passes
        combined = light_from_display(picture.rgba, working_space)
        _fill(b_passes.find_by_name(COMBINED, view), combined)
        b_depth = b_passes.find_by_name(DEPTH, view)
        if b_depth is not None:
            depth = picture.depth[::-1]
            _fill(b_depth, np.where(np.isfinite(depth), depth, np.float32(DEPTH_OF_NOTHING)))
    except BaseException:
        b_engine.end_result(result, cancel=True)
        raise
    b_engine.end_result(result)


def view_names(b_engine: Any, layer: str) -> list[str]:
    """The stereo views Blender expects of this frame; one without a name when stereoscopy is off."""
    result = b_engine.begin_result(0, 0, 1, 1, layer=layer)
    names = [b_view.name for b_view in result.views]
    b_engine.end_result(result, cancel=True)
    return names or [""]


def _fill(b_pass: Any, values: np.ndarray) -> None:
    # foreach_set takes milliseconds where assigning `rect` takes seconds.
    b_pass.rect.foreach_set(np.ascontiguousarray(values, dtype=np.float32).reshape(-1))
