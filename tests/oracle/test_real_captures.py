# SPDX-License-Identifier: GPL-3.0-or-later
"""The oracle's bounds on real captures: patches against every splat evaluated at every pixel."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from .picture import gather, render
from .plain_scene import PlainCamera, PlainCloud, PlainScene, scene_of
from .scene_like import Float64Array

REAL = Path(__file__).parents[2].parent / "shared" / "data" / "real"


def capture(name: str, view: int) -> tuple[PlainScene, PlainCamera]:
    """A capture of the shared data, read without the engine, and one of its cameras."""
    plyfile = pytest.importorskip("plyfile")
    if not REAL.exists():
        pytest.skip("the shared captures are not here")
    vertex = plyfile.PlyData.read(REAL / f"{name}.ply")["vertex"]

    def columns(*names: str) -> Float64Array:
        return np.stack([np.asarray(vertex[column], dtype=np.float64) for column in names], axis=1)

    rest_names = [f"f_rest_{k}" for k in range(sum(p.name.startswith("f_rest_") for p in vertex.properties))]
    count = len(vertex["x"])
    rest = columns(*rest_names).reshape(count, 3, -1).swapaxes(1, 2) if rest_names else np.zeros((count, 0, 3))
    cloud = PlainCloud(
        position=columns("x", "y", "z"),
        scale=np.exp(columns("scale_0", "scale_1", "scale_2")),
        rotation=columns("rot_0", "rot_1", "rot_2", "rot_3"),
        opacity=1.0 / (1.0 + np.exp(-columns("opacity")[:, 0])),
        sh_dc=columns("f_dc_0", "f_dc_1", "f_dc_2"),
        sh_rest=rest,
    )
    shot = json.loads((REAL / f"{name}_cameras.json").read_text())[view]
    rotation = np.array(shot["rotation"]).T
    pose = np.hstack([rotation, -rotation @ np.array(shot["position"])[:, None]])
    width, height = shot["width"], shot["height"]
    return scene_of(cloud), PlainCamera(pose, width, height, shot["fx"], shot["fy"], width / 2, height / 2)


def pixel_by_definition(scene: PlainScene, camera: PlainCamera, column: int, row: int) -> Float64Array:
    """Premultiplied RGBA of one pixel from all splats, with no bound on any."""
    splats = gather(scene, camera, 0.0, 0.3, False, None)
    d = np.array([column + 0.5, row + 0.5]) - splats.mean_px
    distance2 = (d * np.linalg.solve(splats.covariance_px2, d[:, :, None])[:, :, 0]).sum(axis=1)
    alpha = np.minimum(0.99, splats.opacity * np.exp(-0.5 * distance2))
    alpha = np.where(alpha < 1 / 255, 0.0, alpha)
    order = np.argsort(splats.depth, kind="stable")
    left = np.concatenate([[1.0], np.cumprod(1.0 - alpha[order])])
    weight = alpha[order] * left[:-1]
    return np.array([*(weight @ splats.colour[order]), 1.0 - left[-1]])


@pytest.mark.real
@pytest.mark.parametrize(("name", "view"), [("koala", 2), ("rubber_toy_cloud", 5)])
def test_bounds_lose_nothing(name: str, view: int) -> None:
    scene, camera = capture(name, view)
    patch = render(scene, replace(camera, window=(300, 220, 40, 30))).rgba
    assert patch[..., 3].mean() > 0.5  # the patch shows the subject
    for column, row in ((0, 0), (17, 11), (39, 29)):
        np.testing.assert_allclose(
            patch[row, column], pixel_by_definition(scene, camera, 300 + column, 220 + row), atol=1e-12
        )
