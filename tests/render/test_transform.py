# SPDX-License-Identifier: GPL-3.0-or-later
"""A transform baked into a cloud makes the picture that the transform on its instance made."""

from __future__ import annotations

import numpy as np
import pytest

from stipple.engine.edit.sh_rotation import band_matrices, rotate_sh
from stipple.engine.edit.transform import transform_cloud
from stipple.engine.errors import StippleError
from stipple.engine.renderer import Renderer
from stipple.engine.scene import Instance, Scene
from stipple.engine.settings import Settings
from tests.oracle.projection import rotation_matrices
from tests.oracle.sh import basis
from tests.scenes import front_camera, random_cloud
from tests.stats.image_metrics import psnr


def some_rotation(seed: int) -> np.ndarray:
    quaternion = np.random.default_rng(seed).normal(size=(1, 4))
    return rotation_matrices(quaternion)[0]


def about(linear: np.ndarray, pivot: tuple[float, float, float] = (0.0, 0.0, 4.0)) -> np.ndarray:
    """A map (3, 4) that leaves the pivot, in front of the camera, where it is."""
    return np.column_stack([linear, np.asarray(pivot) - linear @ np.asarray(pivot)])


@pytest.mark.parametrize("sh_degree", range(5))
@pytest.mark.parametrize("kind", ["rotation", "uniform scale", "mirror", "all three"])
def test_picture_stays(renderer: Renderer, sh_degree: int, kind: str) -> None:
    linear = {
        "rotation": some_rotation(3),
        "uniform scale": 1.7 * np.eye(3),
        "mirror": np.diag([1.0, -1.0, 1.0]),
        "all three": -0.6 * some_rotation(8),
    }[kind]
    check(renderer, random_cloud(400, 4, sh_degree=sh_degree), about(linear), 60)


def test_uneven_scale_and_shear_keep_shapes(renderer: Renderer) -> None:
    linear = np.array([[1.4, 0.3, 0.0], [0.0, 0.6, -0.2], [0.1, 0.0, 1.0]])
    check(renderer, random_cloud(400, 4), about(linear), 60)


def check(renderer: Renderer, cloud: object, placed: np.ndarray, least_db: float) -> None:
    settings = Settings(method="sorted")
    before = Scene((Instance(cloud, placed),))  # type: ignore[arg-type]
    after = Scene((Instance(transform_cloud(cloud, placed)),))  # type: ignore[arg-type]
    wanted, baked = (renderer.render(scene, front_camera(), settings).rgba for scene in (before, after))
    assert wanted[..., 3].mean() > 0.2
    assert psnr(baked, wanted) > least_db


@pytest.mark.parametrize("mirrored", [False, True])
def test_sh_rotation_is_exact(mirrored: bool) -> None:
    """Colour from a direction before equals colour from the turned direction after, to float64's last digits."""
    rng = np.random.default_rng(1)
    rotation = some_rotation(5) * (-1 if mirrored else 1)
    directions = rng.normal(size=(200, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    coefficients = rng.normal(size=(1, 24, 3))
    for degree in range(1, 5):
        count = (degree + 1) ** 2 - 1
        matrices = band_matrices(rotation, degree)
        assert all(np.allclose(matrix @ matrix.T, np.eye(len(matrix)), atol=1e-12) for matrix in matrices)
        turned = rotate_sh(coefficients[:, :count], rotation, degree)
        before = basis(directions, degree)[:, 1:] @ coefficients[0, :count]
        after = basis(directions @ rotation.T, degree)[:, 1:] @ turned[0]
        np.testing.assert_allclose(after, before, atol=1e-12)


def test_flattening_is_refused_and_nothing_is_changed() -> None:
    cloud = random_cloud(10, 1, sh_degree=2)
    before = cloud.position.copy()
    with pytest.raises(StippleError, match="flattens the capture"):
        transform_cloud(cloud, about(np.diag([1.0, 0.0, 1.0])))
    transform_cloud(cloud, about(some_rotation(1)))
    assert np.array_equal(before, cloud.position)
