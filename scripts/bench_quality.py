# SPDX-License-Identifier: GPL-3.0-or-later
"""How long *points* accumulates until it is within 40 dB of the reference."""

from __future__ import annotations

import time
from typing import Any

import numpy as np

from stipple.engine.camera import Camera
from stipple.engine.renderer import Frame, Renderer
from stipple.engine.scene import Scene
from stipple.engine.settings import Settings

WANTED_DB = 40.0
MOST_SAMPLES = 512
REFERENCE_SUPERSAMPLING = 4  # of sorted: points converge to means over pixels, not to values at their centres


def psnr(picture: np.ndarray, reference: np.ndarray) -> float:
    """Of sRGB-encoded RGB, clamped to what a screen shows [dB]."""
    shown, wanted = (np.clip(image[..., :3], 0.0, 1.0).astype(np.float64) for image in (picture, reference))
    return float(-10.0 * np.log10(max(np.square(shown - wanted).mean(), 1e-20)))


def time_to_quality(renderer: Renderer, scene: Scene, camera: Camera, supersampling: int) -> dict[str, Any]:
    """Samples and seconds (wall and core) until WANTED_DB; without success, what MOST_SAMPLES reached.

    Looks at the picture where the law of noise, 10 dB in ten times the samples, says that it may be reached.
    """
    reference = renderer.render(scene, camera, Settings(method="sorted", supersampling=REFERENCE_SUPERSAMPLING)).rgba
    frame = Frame(renderer, scene, camera, Settings(samples=MOST_SAMPLES, supersampling=supersampling))
    seconds, core, reached, look = 0.0, 0.0, 0.0, 1
    for sample in range(MOST_SAMPLES):
        begin, begin_core = time.perf_counter(), time.process_time()
        frame.render_sample(sample)
        seconds, core = seconds + time.perf_counter() - begin, core + time.process_time() - begin_core
        if sample + 1 < look:
            continue
        reached = psnr(frame.resolve().rgba, reference)
        if reached >= WANTED_DB:
            break
        # Noise falls by 10 dB in ten times the samples; look again a little earlier than it says.
        look = max(sample + 2, int(0.9 * (sample + 1) * 10 ** ((WANTED_DB - reached) / 10)))
        look = min(look, MOST_SAMPLES)
    return {
        "wanted_db": WANTED_DB,
        "reached_db": reached,
        "samples": frame.film.samples,
        "seconds": seconds,
        "core_seconds": core,
    }
