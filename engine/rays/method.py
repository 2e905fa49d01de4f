# SPDX-License-Identifier: GPL-3.0-or-later
"""A frame of *rays*, stage by stage: textures, order, draw, film.

Of `Settings`, `dilation_px2` is the pixel filter's variance (§5; 0 for plain RayGS) and `antialiased` its opacity
modulation (Eq. 17). Captures trained by 3DGS want 0.3 without, Mip-Splatting's want 0.1 with.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import warp as wp

from ..device import launch
from ..device_look import OPAQUE, SHADED
from ..film import Film, FilmSums
from ..maths.random import stream_key
from ..shot import Shot
from .host import Draw, FloatArray
from .interface import Variant
from .order import least_opacity

wp.set_module_options({"enable_backward": False})


@wp.kernel
def add_to_film_kernel(
    first: wp.int32, colour: wp.array(dtype=wp.vec4), depth: wp.array(dtype=wp.float32), sums: FilmSums
) -> None:
    i = first + wp.tid()
    sums.colour[i] = sums.colour[i] + wp.vec4d(colour[i])
    sums.depth[i] = sums.depth[i] + wp.float64(depth[i])


def add_to_film(colour: FloatArray, depth: FloatArray, film: Film) -> None:
    """Add one sample: premultiplied colour (H, W, 4), depth times coverage (H, W)."""
    device = film.device
    arrays = [
        wp.from_numpy(np.ascontiguousarray(colour.reshape(-1, 4)), dtype=wp.vec4, device=device),
        wp.from_numpy(np.ascontiguousarray(depth.ravel()), dtype=wp.float32, device=device),
    ]
    launch(add_to_film_kernel, depth.size, [*arrays, film.sums], device)
    film.samples += 1


class RaysFrame:
    """One camera's view of a scene.

    Sorted order takes one sample per subpixel, stochastic `samples` of each. Does not count blends: the graphics
    hardware does not tell.
    """

    def __init__(self, shot: Shot) -> None:
        settings, raster = shot.settings, shot.raster()
        self._host, self._camera, self._settings, self._timer = raster.host, shot.camera, settings, shot.timer
        self.sample_count = settings.supersampling**2 * (settings.samples if settings.ray_order == "stochastic" else 1)
        self.points, self.blends = 0, 0
        self.warnings: tuple[str, ...] = ()
        with shot.timer.stage("textures"):
            raster.upload(shot)
        self._variant = Variant(stochastic=settings.ray_order == "stochastic", paged=raster.pages > 1)
        with shot.timer.stage("order"):
            self.splats_visible = raster.upload_order(shot).count

    def render_sample(self, sample: int, film: Film, checkpoint: Callable[[], None]) -> None:
        """Add sample number `sample` to the film: subpixel number `sample` modulo s² of every pixel."""
        checkpoint()
        with self._timer.stage("draw"):
            colour, depth = self._host.draw(self.draw_of(sample))
        with self._timer.stage("film"):
            add_to_film(colour, depth, film)

    def draw_of(self, sample: int) -> Draw:
        """What the host is told to draw for a sample."""
        camera, settings, s = self._camera, self._settings, self._settings.supersampling
        x, y, width, height = camera.rendered_window
        # A subpixel is seen at its pixel's centre when everything moves the other way.
        shift = (0.5 - (sample % s + 0.5) / s, 0.5 - (sample // s % s + 0.5) / s)
        stream = stream_key(settings.seed, sample, 0) & 0x7FFFFFFF
        cut = (least_opacity(settings), settings.alpha_max, OPAQUE, SHADED)
        return Draw(
            width=width,
            height=height,
            splat_count=self.splats_visible,
            constants={
                "lens": (camera.fx, camera.fy, camera.cx - x + shift[0], camera.cy - y + shift[1]),
                "window": (x, y, width, height),
                "cut": cut,
                "modes": (int(camera.projection == "orthographic"), 0, stream, self.splats_visible),
            },
            variant=self._variant,
            multisamples=settings.multisamples,
        )
