# SPDX-License-Identifier: GPL-3.0-or-later
"""*points* has the oracle's mean: z-tests over 32 seeds, convergence without plateau, the effect of K.

The reference is the oracle at 4 × 4 subpixels (what *sorted* shows, less its early stop, which these tests would see).
"""

from __future__ import annotations

import numpy as np
import pytest

from stipple.engine.renderer import Frame, Renderer
from stipple.engine.scene import Scene
from stipple.engine.settings import Settings
from tests.oracle.picture import render as oracle
from tests.scenes import FRAME, cloud_of, front_camera, random_cloud, scene_of
from tests.stats.convergence import convergence_slope, find_plateau
from tests.stats.z_test import tile_groups, z_test

SEEDS = range(32)


def large_splats(seed: int = 21) -> Scene:
    """Splats of 4 px and more, where sampling at pixel centres and over their areas agree."""
    return scene_of(random_cloud(25, seed, sigma_px=(4.0, 14.0), sh_degree=1))


def seeds_of(renderer: Renderer, scene: Scene, samples: int, **changes: object) -> np.ndarray:
    """Pictures (32, H, W, 4), one per seed."""
    pictures = []
    for seed in SEEDS:
        settings = Settings(samples=samples, seed=seed, **changes)  # type: ignore[arg-type]
        pictures.append(renderer.render(scene, front_camera(), settings).rgba)
    return np.stack(pictures)


def check(pictures: np.ndarray, reference: np.ndarray, samples: int) -> None:
    pooled = z_test(pictures, reference)
    assert pooled.passes(), pooled.worst()
    groups = tile_groups(*reference.shape[:2], 8, samples * reference[..., 3], 30.0)
    tiles = z_test(pictures, reference, groups)
    assert tiles.passes(), tiles.worst()


@pytest.mark.parametrize("supersampling", [1, 2])
def test_mean_is_the_oracles(renderer: Renderer, supersampling: int) -> None:
    scene = large_splats()
    reference = oracle(scene, front_camera(), supersampling=4).rgba
    check(seeds_of(renderer, scene, 16, supersampling=supersampling), reference, 16 * supersampling**2)


def test_mean_is_right_in_many_passes_and_where_splats_are_filled(renderer: Renderer) -> None:
    rng = np.random.default_rng(2)
    position = np.column_stack([rng.uniform(-1, 1, (4, 2)), rng.uniform(2, 6, 4)])
    cloud = cloud_of(position, rng.uniform(0.5, 30, (4, 3)), rng.uniform(0.1, 0.6, 4), rng.uniform(0, 1, (4, 3)))
    scene = scene_of(cloud, random_cloud(10, 5, sigma_px=(4, 9)))
    reference = oracle(scene, front_camera(), supersampling=4).rgba
    pictures = seeds_of(renderer, scene, 16, max_points=1024)
    check(pictures, reference, 16)
    stats = renderer.render(scene, front_camera(), Settings(samples=1, max_points=1024)).stats
    assert "passes" in stats.warnings[0] and stats.points > 4 * 1024


def test_passes_change_nothing(renderer: Renderer) -> None:
    pictures = [
        renderer.render(large_splats(), front_camera(), Settings(samples=3, max_points=limit)).rgba
        for limit in (1024, 5000, 1 << 24)
    ]
    assert np.array_equal(pictures[0], pictures[1]) and np.array_equal(pictures[0], pictures[2])


def test_error_falls_with_samples_without_plateau(renderer: Renderer) -> None:
    """Mean squared error: slope -1 in log-log from 1 to 1024 samples."""
    scene = scene_of(random_cloud(60, 33, sigma_px=(8.0, 20.0)))
    reference = oracle(scene, front_camera(), supersampling=4).rgba
    samples = 2 ** np.arange(11)
    runs = []
    for seed in range(3):
        frame = Frame(renderer, scene, front_camera(), Settings(samples=1024, seed=100 + seed))
        errors = []
        for sample in range(1024):
            frame.render_sample(sample)
            if sample + 1 in samples:
                errors.append(((frame.resolve().rgba - reference) ** 2).mean())
        runs.append(errors)
    slope = convergence_slope(samples, np.array(runs))
    assert abs(slope.value + 1) < 0.1, slope
    plateau = find_plateau(samples, np.array(runs))
    assert plateau.p_value > 1e-3, plateau


def test_rounding_counts_to_multiples_of_k_keeps_the_number_of_points(renderer: Renderer) -> None:
    """K > 1 is the paper's trade: as many points, in clumps, which costs some opacity."""
    scene = large_splats()
    one, four = (renderer.render(scene, front_camera(), Settings(samples=64, points_per_thread=k)) for k in (1, 4))
    assert abs(four.stats.points / one.stats.points - 1) < 0.01
    assert four.rgba[..., 3].mean() <= one.rgba[..., 3].mean() + 1e-3
    grid = np.stack(np.meshgrid(np.linspace(-1.8, 1.8, 10), np.linspace(-1.3, 1.3, 10), [4.0]), -1).reshape(-1, 3)
    small = scene_of(cloud_of(grid, 0.3 * 4 / 60, 0.5, (1, 1, 1)))
    light = [
        renderer.render(small, front_camera(), Settings(samples=128, points_per_thread=k)).rgba[..., 3].sum()
        for k in (1, 4)
    ]
    assert light[1] < 0.9 * light[0]  # the bias that makes K = 1 the default


def test_background_and_coverage_agree(renderer: Renderer) -> None:
    scene = large_splats()
    over = Scene(scene.instances, (0.2, 0.4, 0.8))
    settings = Settings(samples=8)
    alone = renderer.render(scene, front_camera(), settings).rgba
    composed = renderer.render(over, front_camera(), settings).rgba
    wanted = alone[..., :3] + (1 - alone[..., 3:]) * np.array((0.2, 0.4, 0.8))
    assert np.abs(composed[..., :3] - wanted).max() < 1e-6
    assert FRAME[::-1] == composed.shape[:2] and (composed[..., 3] == 1).all()
