# SPDX-License-Identifier: GPL-3.0-or-later
"""The oracle against the picture gsplat itself made of four splats."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from .picture import render
from .plain_scene import PlainCamera, PlainCloud, scene_of
from .scene_like import Float64Array

TINY_CASE = Path(__file__).parents[2].parent / "shared" / "data" / "formats" / "tiny_case.safetensors"


def tiny_case(quaternion_order: tuple[int, ...] = (0, 1, 2, 3)) -> tuple[PlainCloud, PlainCamera, Float64Array]:
    """The case's cloud and camera, and gsplat's premultiplied RGBA image (82, 123, 4)."""
    safetensors = pytest.importorskip("safetensors.numpy")
    if not TINY_CASE.exists():
        pytest.skip("the shared captures are not here")
    stored = {name: array.astype(np.float64) for name, array in safetensors.load_file(TINY_CASE).items()}
    cloud = PlainCloud(
        position=stored["means"],
        scale=np.exp(stored["scales"]),
        rotation=stored["quats"][:, quaternion_order],
        opacity=1.0 / (1.0 + np.exp(-stored["opacities"])),
        sh_dc=stored["coeffs"][:, 0],
        sh_rest=stored["coeffs"][:, 1:],
    )
    height, width = stored["out_img"].shape[:2]
    pose = np.hstack([np.eye(3), [[-0.123], [-0.456], [8.0]]])
    focal = width / 2  # a horizontal field of view of 90 degrees
    camera = PlainCamera(pose, width, height, focal, focal, width / 2, height / 2)
    return cloud, camera, stored["out_img"]


@pytest.mark.real
def test_oracle_agrees_with_gsplat() -> None:
    """Measured: 1.3e-6 at most.

    Found by trying: quaternions are w, x, y, z and not normalised; pixels are square; the background is transparent
    black and the fourth channel is alpha; opacity is not compensated. No colour is negative and no alpha reaches
    0.99, so the case says nothing about either clamp.
    """
    cloud, camera, expected = tiny_case()
    picture = render(scene_of(cloud), camera, alpha_max=0.999)
    assert picture.rgba.shape == expected.shape
    assert expected[..., 3].max() > 0.7
    np.testing.assert_allclose(picture.rgba, expected, atol=3e-6, rtol=0)


@pytest.mark.real
def test_other_readings_of_the_case_are_far_off() -> None:
    """The agreement above would not survive another quaternion order, the Mip-Splatting option or no SH."""
    cloud, camera, expected = tiny_case(quaternion_order=(3, 0, 1, 2))
    assert abs(render(scene_of(cloud), camera, alpha_max=0.999).rgba - expected).max() > 0.1
    cloud, camera, expected = tiny_case()
    assert abs(render(scene_of(cloud), camera, antialiased=True).rgba - expected).max() > 0.01
    assert abs(render(scene_of(cloud), camera, sh_degree=2).rgba - expected).max() > 0.01
