# SPDX-License-Identifier: GPL-3.0-or-later
"""What *rays* hands to a graphics host: texels, the order of drawing, declarations, settings."""

from __future__ import annotations

import re

import numpy as np
import pytest

from stipple.engine.buffers import Buffers
from stipple.engine.camera import Camera
from stipple.engine.device import choose_device
from stipple.engine.device_cloud import upload_cloud
from stipple.engine.device_look import make_device_look
from stipple.engine.errors import StippleError
from stipple.engine.rays import interface
from stipple.engine.rays.host import batch_corners, batch_triangles
from stipple.engine.rays.order import find_order
from stipple.engine.rays.texels import (
    as_rectangle,
    keeps_angles,
    pack_instances,
    pack_order,
    splat_pages,
    texels_per_splat,
)
from stipple.engine.renderer import Renderer
from stipple.engine.scene import Instance, Scene
from stipple.engine.settings import Settings
from stipple.engine.splats import SplatCloud
from stipple.engine.timing import StageTimer
from tests.oracle.rays import gather, opacities, pixel_rays
from tests.scenes import cloud_of, front_camera, random_cloud, scene_of


def order_of(scene: Scene, camera: Camera, by_depth: bool = True) -> list[tuple[int, int]]:
    settings = Settings(dilation_px2=0.0, ray_order="sorted" if by_depth else "stochastic")
    renderer = Renderer("cpu")
    order = find_order(renderer.shot(scene, camera, settings, StageTimer(renderer.device)))
    return list(zip(order.splat.tolist(), order.instance.tolist(), strict=True))


def records_of(cloud: SplatCloud, device: str) -> np.ndarray:
    """(N, texels per splat, 4), packed on the device, over pages of 49 texels that end inside records."""
    buffers = Buffers(choose_device(device))
    pages = splat_pages([upload_cloud(cloud, buffers.device)], 7, 64, buffers)
    texels = np.concatenate([page.reshape(-1, 4) for page in pages])
    per_splat = texels_per_splat(cloud.sh_degree)
    return texels[: cloud.splat_count * per_splat].reshape(-1, per_splat, 4)


@pytest.mark.parametrize("degree", range(5))
def test_records_hold_every_value_once(device: str, degree: int) -> None:
    cloud = random_cloud(7, degree, sh_degree=degree)
    records = records_of(cloud, device)
    assert records.shape == (7, texels_per_splat(degree), 4)
    assert (records[:, 0] == np.column_stack([cloud.position, cloud.opacity])).all()
    assert (records[:, 1] == cloud.rotation).all()
    assert (records[:, 2, :3] == cloud.scale).all()
    assert (records[:, 3, :3] == cloud.sh_dc).all()
    for k in range(cloud.sh_rest.shape[1]):
        texel = 4 + k // 4 * 3
        assert (records[:, texel : texel + 3, k % 4] == cloud.sh_rest[:, k]).all()


def test_instances_share_the_records_of_a_cloud() -> None:
    first, second = random_cloud(7, 1, sh_degree=3), random_cloud(9, 2)
    moved = np.hstack([np.eye(3), [[1.0], [2.0], [3.0]]])
    scene = Scene((Instance(first), Instance(second), Instance(first, moved)))
    held = [upload_cloud(cloud, choose_device("cpu")) for cloud in (first, second)]
    looks = [make_device_look(i.look, i.world_from_object, Settings()) for i in scene.instances]
    texels, clouds = pack_instances(scene, front_camera(), [held[0], held[1], held[0]], looks)
    assert [cloud is wanted for cloud, wanted in zip(clouds, held, strict=True)] == [True, True]
    starts = texels[:, 4, 0] * 65536 + texels[:, 4, 1]
    assert starts.tolist() == [0, 7 * 16, 0]
    assert texels[:, 4, 3].tolist() == [0, 0, 0]  # no sweeps where a map keeps angles
    np.testing.assert_allclose(texels[2, 3, :3], [-1, -2, -3])  # the eye, in object space
    np.testing.assert_allclose(texels[2, :3, 3], [1, 2, 3])


@pytest.mark.parametrize("stretch", [1.0, 1.001])
def test_only_maps_that_keep_angles_do_without_sweeps(stretch: float) -> None:
    turn = np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))[0]  # mirrors, perhaps
    assert keeps_angles(1e-3 * turn @ np.diag([1.0, 1.0, stretch])) == (stretch == 1.0)


def test_batches_hold_whole_quads() -> None:
    corners, triangles = batch_corners(), batch_triangles()
    assert (corners[triangles, 2] == np.repeat(np.arange(len(corners) // 4), 2)[:, None]).all()
    x, y = np.moveaxis(corners[triangles[:2], :2], -1, 0)
    twice_area = (x[:, 1] - x[:, 0]) * (y[:, 2] - y[:, 0]) - (x[:, 2] - x[:, 0]) * (y[:, 1] - y[:, 0])
    assert np.abs(twice_area).tolist() == [4.0, 4.0]  # two halves of the square from -1 to 1


def test_indices_beyond_a_floats_precision_survive() -> None:
    splat = np.array([0, 1, (1 << 24) + 1, (1 << 31) - 1])
    texels = pack_order(splat, np.array([0, 1, 2, 3]), np.zeros(4, bool))
    assert (texels[:, 0].astype(np.int64) * 65536 + texels[:, 1].astype(np.int64) == splat).all()


def test_texels_are_laid_in_rows_and_too_many_are_refused() -> None:
    texels = np.arange(40, dtype=np.float32).reshape(10, 4)
    rectangle = as_rectangle(texels, 4, 16, "the captures")
    assert rectangle.shape == (3, 4, 4)
    assert (rectangle.reshape(-1, 4)[:10] == texels).all()
    with pytest.raises(StippleError, match="the captures take 10 texels"):
        as_rectangle(texels, 4, 2, "the captures")


def test_drawn_from_far_to_near_with_ties_in_reverse() -> None:
    """Blending starts at the far end, so what comes first among equals, as the nearer, is drawn last."""
    cloud = cloud_of([[0, 0, z] for z in (3.0, 5.0, 3.0, 0.1, 4.0)], 0.1, 0.5, 0.5)
    scene = Scene((Instance(cloud), Instance(cloud)))
    wanted = [(1, 1), (1, 0), (4, 1), (4, 0), (2, 1), (0, 1), (2, 0), (0, 0)]
    assert order_of(scene, front_camera()) == wanted
    assert order_of(scene, front_camera(), by_depth=False) == [(k, i) for i in (0, 1) for k in (0, 1, 2, 4)]


@pytest.mark.parametrize("projection", ["pinhole", "orthographic"])
def test_culling_loses_nothing(projection: str) -> None:
    """Whatever the oracle can see in the window is drawn, and not everything is."""
    rng, focal = np.random.default_rng(4), 20.0 if projection == "pinhole" else 5.0
    position = rng.normal(size=(3000, 3)) * [8, 8, 6]
    cloud = cloud_of(position, 10.0 ** rng.uniform(-3, 0, (3000, 3)), rng.uniform(0, 1, 3000), 0.5, [1, 0, 0, 0])
    camera = front_camera(projection=projection, window=(40, 5, 12, 30), fx=focal, fy=focal)
    splats = gather(scene_of(cloud), camera)
    rays = pixel_rays(camera, 1)
    touched = [k for k in range(len(splats.mean)) if opacities(splats, k, *rays, 1 / 255, 0.99)[0].any()]
    drawn = {splat for splat, _ in order_of(scene_of(cloud), camera)}
    where = {tuple(place): k for k, place in enumerate(cloud.position.tolist())}
    needed = {where[tuple(place)] for place in splats.mean[touched].tolist()}
    assert len(needed) > 20
    assert needed <= drawn
    assert len(drawn) < 1500


def test_both_hosts_get_the_same_declarations() -> None:
    variant = interface.Variant(stochastic=True, paged=True)
    info, stage = interface.create_info_calls(variant)
    declared = {call[-1] for call in info + stage if call[0] != "define"}
    header = "".join(interface.header(stage, variant, per_sample=False) for stage in ("vertex", "fragment"))
    in_glsl = set(re.findall(r"(\w+);", header))
    assert in_glsl <= declared
    assert declared - in_glsl == {"ANY"}  # how depth is written, which plain GLSL need not say
    assert {call[1] for call in info if call[0] == "define"} == set(re.findall(r"#define (\w+)", header))
    plain = interface.header("fragment", interface.Variant(), per_sample=False)
    assert "STOCHASTIC" not in plain and "PAGED" not in plain


def test_sources_declare_nothing_and_constants_fit_where_vulkan_wants_them() -> None:
    for stage in ("vertex", "fragment"):
        assert not re.search(r"^\s*(uniform|in|out|layout|flat|smooth)\s", interface.source(stage), re.MULTILINE)
    assert 16 * len(interface.CONSTANTS) <= 128
    assert all(value.glsl_type in ("vec4", "ivec4") for value in interface.CONSTANTS)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"ray_order": "random"}, "choose one of sorted, stochastic"),
        ({"multisamples": 3}, "choose one of"),
        ({"multisamples": 4, "ray_order": "stochastic"}, "use samples or supersampling"),
    ],
)
def test_settings_out_of_range_are_refused(changes: dict[str, object], message: str) -> None:
    with pytest.raises(StippleError, match=message):
        Settings(**changes)  # type: ignore[arg-type]
