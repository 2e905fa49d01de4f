# SPDX-License-Identifier: GPL-3.0-or-later
"""The oracle: what a picture of splats must be, in float64 NumPy, written apart from the engine.

It shares no code with `engine/` and trades speed for plainness: one splat after the other, no tiles, no
3-sigma cut, no early stop. `render` takes anything with the attributes of a scene and a camera.
"""

from .picture import OraclePicture, render

__all__ = ["OraclePicture", "render"]
