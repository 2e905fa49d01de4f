# SPDX-License-Identifier: GPL-3.0-or-later
"""*rays* of clouds that are quantised on the device, or that only the device holds."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

from stipple.engine.device_cloud import DeviceCloud
from stipple.engine.quantise import quantise
from stipple.engine.renderer import Renderer
from stipple.engine.scene import Instance, Scene
from stipple.engine.settings import Settings
from stipple.engine.splats import SplatCloud
from tests.scenes import front_camera, random_cloud, scene_of
from tests.stats.image_metrics import psnr


@dataclass(frozen=True, eq=False)
class OnDevice:
    """A `DeviceSource`: what it hands out has no arrays on the host."""

    made_of: SplatCloud
    name: str = "stream"

    @property
    def splat_count(self) -> int:
        return self.made_of.splat_count

    @property
    def sh_degree(self) -> int:
        return self.made_of.sh_degree

    @property
    def nbytes(self) -> int:
        return 0

    @property
    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        return self.made_of.bounds

    def upload(self, device: Any, progress: Any) -> DeviceCloud:
        return quantise(lambda _arrays: [self.made_of], self.splat_count, self.sh_degree, self.name, device)


def picture(rays: Renderer, scene: Scene, storage: str = "full", order: str = "sorted") -> np.ndarray:
    settings = Settings(method="rays", storage=storage, ray_order=order, samples=4)
    return rays.render(scene, front_camera(), settings).rgba


@pytest.mark.parametrize("degree", range(5))
def test_quantised_clouds_look_the_same(rays: Renderer, degree: int) -> None:
    """As far as their bits allow; and going back brings the very same picture, not the other storage's textures."""
    scene = scene_of(random_cloud(300, degree, sh_degree=degree))
    full = picture(rays, scene)
    quantised = picture(rays, scene, "quantised")
    assert 40 < psnr(quantised, full) < 100
    assert (picture(rays, scene) == full).all()


@pytest.mark.parametrize("order", ["sorted", "stochastic"])
def test_a_cloud_without_host_arrays_is_drawn(rays: Renderer, order: str) -> None:
    """Beside one that the host holds, so that records of both kinds follow each other."""
    cloud, other = random_cloud(300, 1, sh_degree=3), random_cloud(40, 2, sh_degree=1)
    streamed = Scene((Instance(OnDevice(cloud)), Instance(OnDevice(other))))
    wanted = picture(rays, scene_of(cloud, other), "quantised", order)
    assert wanted[..., 3].mean() > 0.1
    assert (picture(rays, streamed, "full", order) == wanted).all()
    mixed = picture(rays, Scene((Instance(OnDevice(cloud)), Instance(other))), "full")
    assert psnr(mixed, picture(rays, scene_of(cloud, other))) > 40
