# SPDX-License-Identifier: GPL-3.0-or-later
"""Generated scenes: repeatable, of the size asked for, bounded by their groups, and a picture of what they claim."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
import warp as wp

from stipple.engine.device import choose_device, launch
from stipple.engine.device_cloud import DeviceCloud, read_rotation, read_splat
from stipple.engine.errors import StippleError
from stipple.engine.renderer import Renderer
from stipple.engine.scene import Instance, Scene
from stipple.engine.settings import Settings
from stipple.engine.splats import packed_bytes_per_splat
from stipple.scripts.bench_presets import city_path
from stipple.scripts.generated_scenes import DisplacedCopies, GeneratedCity
from stipple.scripts.generated_scenes.city_patches import Grid
from stipple.scripts.sample_capture import build_sample

CITY_SPLATS = 200_001  # the last group is not full
wp.set_module_options({"enable_backward": False})


@wp.kernel
def unpack_kernel(
    first: wp.int32,
    cloud: DeviceCloud,
    position: wp.array(dtype=wp.vec3),
    scale: wp.array(dtype=wp.vec3),
    rotation: wp.array(dtype=wp.vec4),
    opacity: wp.array(dtype=wp.float32),
) -> None:
    i = first + wp.tid()
    splat = read_splat(cloud, i)
    position[i] = splat.position
    scale[i] = splat.scale
    rotation[i] = read_rotation(cloud, i)
    opacity[i] = splat.opacity


def unpacked(cloud: DeviceCloud, device: wp.Device) -> tuple[np.ndarray, ...]:
    """Position, scale, rotation, opacity of all places, as kernels read them."""
    arrays = [
        wp.empty(cloud.splat_count, dtype=dtype, device=device) for dtype in (wp.vec3, wp.vec3, wp.vec4, wp.float32)
    ]
    launch(unpack_kernel, cloud.splat_count, [cloud, *arrays], device)
    return tuple(array.numpy() for array in arrays)


def silent(fraction: float, text: str) -> None:
    assert 0.0 <= fraction <= 1.0 and text


def a_city() -> GeneratedCity:
    return GeneratedCity(CITY_SPLATS)


def some_copies() -> DisplacedCopies:
    return DisplacedCopies(build_sample(20_000), 130_000)


@pytest.mark.parametrize("make", [a_city, some_copies])
def test_made_twice_the_bits_are_the_same(make: Callable[[], GeneratedCity | DisplacedCopies], device: str) -> None:
    chosen = choose_device(device)
    one, two = (make().upload(chosen, silent) for _ in range(2))
    colour = "packed_colour" if one.sh_degree == 0 else "packed_rest"
    for name in ("packed_geometry", "packed_opacity", colour):
        assert np.array_equal(getattr(one, name).numpy(), getattr(two, name).numpy()), name
    assert np.array_equal(one.groups.low.numpy(), two.groups.low.numpy())


@pytest.mark.parametrize("make", [a_city, some_copies])
def test_groups_bound_their_splats(make: Callable[[], GeneratedCity | DisplacedCopies], device: str) -> None:
    """The box of the means, and the deviation along x, y, z of each covariance, in float64."""
    chosen = choose_device(device)
    cloud = make().upload(chosen, silent)
    position, scale, rotation, opacity = unpacked(cloud, chosen)
    group = np.arange(cloud.splat_count) >> cloud.groups.shift
    assert group[-1] + 1 == cloud.groups.count
    drawn = opacity > 0.0
    low, high, sigma, most = (getattr(cloud.groups, name).numpy() for name in ("low", "high", "sigma", "opacity"))
    assert (position >= low[group])[drawn].all() and (position <= high[group])[drawn].all()
    assert (opacity <= most[group])[drawn].all()
    w, x, y, z = rotation.astype(np.float64).T
    axes = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )
    deviation = np.sqrt(np.einsum("ijn,nj->ni", axes**2, scale.astype(np.float64) ** 2))
    assert (deviation <= sigma[group] * (1 + 1e-5))[drawn].all()


def test_groups_of_the_city_are_tight(device: str) -> None:
    """Even of so few splats that a group covers a large wall: boxes along the order would be as large as blocks."""
    chosen = choose_device(device)
    city = a_city()
    cloud = city.upload(chosen, silent)
    diagonal = np.linalg.norm(cloud.groups.high.numpy() - cloud.groups.low.numpy(), axis=1)
    assert np.median(diagonal) < 0.08 * np.linalg.norm(2 * city.half_size)


def test_bytes_are_counted(device: str) -> None:
    chosen = choose_device(device)
    city = a_city().upload(chosen, silent)
    assert city.splat_count == CITY_SPLATS
    held = city.packed_geometry.capacity + city.packed_opacity.capacity + city.packed_colour.capacity
    assert held == 21 * CITY_SPLATS
    copies = some_copies()
    made = copies.upload(chosen, silent)
    assert copies.splat_count == 140_000 and packed_bytes_per_splat(copies.sh_degree) == 81
    names = ("packed_geometry", "packed_opacity", "sh_dc", "rest_largest", "packed_rest")
    assert sum(getattr(made, name).capacity for name in names) == 81 * made.splat_count
    assert made.splat_count < 1.05 * copies.splat_count


def test_bounds_hold_all_means(device: str) -> None:
    chosen = choose_device(device)
    for source in (a_city(), some_copies()):
        cloud = source.upload(chosen, silent)
        position, _, _, opacity = unpacked(cloud, chosen)
        low, high = source.bounds
        # Half a step of 23 bits of a group's box, at most.
        assert (position[opacity > 0] >= low - 1e-3).all() and (position[opacity > 0] <= high + 1e-3).all()


def test_a_copy_is_the_capture_moved(device: str) -> None:
    """Splat for splat: the place moves by the copy's displacement, everything else is the same."""
    chosen = choose_device(device)
    source = some_copies()
    cloud = source.upload(chosen, silent)
    one, places = cloud.splat_count // source.copy_count, source.displacements
    assert len(np.unique(places[:, [0, 2]].round(3), axis=0)) == source.copy_count, "no two in one place"
    position, scale, rotation, opacity = (
        array.reshape(source.copy_count, one, -1) for array in unpacked(cloud, chosen)
    )
    for copy in range(1, source.copy_count):
        drawn = opacity[0, :, 0] > 0
        assert drawn.sum() == source.capture.splat_count
        np.testing.assert_allclose(
            (position[copy] - position[0])[drawn], places[copy] - places[0] + 0 * position[0][drawn], atol=1e-5
        )
        for array in (scale, rotation, opacity):
            assert np.array_equal(array[copy], array[0])


def test_the_city_looks_like_one(device: str) -> None:
    """From street level: sky above, street below, walls at either side that hide what is behind."""
    renderer = Renderer(device)
    city = a_city()
    scene = Scene((Instance(city),))
    picture = renderer.render(scene, city_path(city).camera(0.0, (160, 90)), Settings(samples=16))
    alpha = picture.rgba[..., 3]
    assert alpha[-10:].mean() > 0.98, "the street is closed"
    assert alpha[30:60, :15].mean() > 0.95 and alpha[30:60, -15:].mean() > 0.95, "so are the walls"
    assert alpha[:15, 60:100].min() < 0.2, "between the roofs is the sky"
    assert picture.depth[-3:, 60:100].mean() < 15.0
    overview = renderer.render(scene, city_path(city).camera(1.0, (160, 90)), Settings(samples=4)).rgba
    assert overview[..., 3].mean() > 0.5
    rgb = overview[overview[..., 3] > 0.9][:, :3]
    assert np.ptp(np.quantile(rgb, (0.05, 0.95), axis=0), axis=0).min() > 0.15, "in many colours"


def test_too_small_a_city_is_refused_in_one_sentence() -> None:
    with pytest.raises(StippleError, match="ask for at least"):
        GeneratedCity(10_000)


@pytest.mark.parametrize("shift", [8, 9, 10])
def test_a_patch_is_full(shift: int) -> None:
    grid = Grid.of_shift(shift)
    assert grid.fine[0] * grid.fine[1] + grid.coarse[0] * grid.coarse[1] == 1 << shift
