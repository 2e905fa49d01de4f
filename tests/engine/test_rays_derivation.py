# SPDX-License-Identifier: GPL-3.0-or-later
"""Each step of the RayGS derivation against its definition: random primitives over twelve decades of scale."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tests.oracle.plain_scene import PlainCamera, cloud_of, scene_of
from tests.oracle.rays import divergence, gather, mip_modulation, pixel_rays, render
from tests.oracle.rays_steps import (
    Primitive,
    divergence_on_quad,
    phi,
    phi_inverse,
    quad,
    rotation_to,
)

SEEDS = range(24)
CIRCLE = np.stack([np.cos(np.linspace(0, 2 * np.pi, 33)), np.sin(np.linspace(0, 2 * np.pi, 33))])


def random_primitive(seed: int, closeness: float | None = None) -> Primitive:
    """Any place, size from 1e-6 to 1e6, axes up to 1 : 10⁴ apart; c² = κ (1 + closeness), or from 1.001 κ to 10⁸ κ."""
    rng = np.random.default_rng(seed)
    s = 10.0 ** rng.uniform(-4, 0, 3)
    s /= s.max()
    r_p = Rotation.random(random_state=seed).as_matrix()
    kappa = rng.uniform(0.05, 11.0)
    excess = 10.0 ** rng.uniform(-3, 8) if closeness is None else closeness
    direction = r_p @ (s * rng.normal(size=3)) if seed % 2 else rng.normal(size=3)
    c_of_direction = np.linalg.norm((r_p.T @ direction) / s)
    size = 10.0 ** rng.uniform(-6, 6)
    mu = direction / c_of_direction * np.sqrt(kappa * (1.0 + excess))
    return Primitive(mu * size, r_p, s * size, kappa)


def d_ray(primitive: Primitive, rays: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Eq. 5 by the oracle, for rays (3, N)."""
    whitening = primitive.r_p.T / primitive.s[:, None]
    return divergence(whitening, primitive.mu, np.zeros_like(rays.T), rays.T)


@pytest.mark.parametrize("seed", SEEDS)
def test_rotation_takes_v_to_mu_hat(seed: int) -> None:
    rng = np.random.default_rng(seed)
    mu_hat = rng.normal(size=3) * 10.0 ** rng.uniform(-9, 0, 3)
    mu_hat[2] = abs(mu_hat[2]) if seed % 2 else -abs(mu_hat[2])
    mu_hat /= np.linalg.norm(mu_hat)
    rotation = rotation_to(mu_hat)
    np.testing.assert_allclose(rotation @ [0, 0, 1], mu_hat, atol=1e-14)
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-14)
    assert np.linalg.det(rotation) == pytest.approx(1.0)


def test_rotation_at_its_poles() -> None:
    for mu_hat in ([0.0, 0.0, 1.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]):
        np.testing.assert_allclose(rotation_to(np.array(mu_hat)) @ [0, 0, 1], mu_hat, atol=1e-15)


@pytest.mark.parametrize("seed", SEEDS)
def test_phi_maps_the_ellipse_to_the_unit_circle_and_back(seed: int) -> None:
    p = random_primitive(seed)
    e = phi_inverse(p, CIRCLE)
    np.testing.assert_allclose(phi(p, e), CIRCLE, atol=1e-6)
    # Prop. A.5 and A.4: e lies on the ellipse E, at τ = 1.
    c2 = p.c**2
    np.testing.assert_allclose((e * (p.inverse_covariance @ e)).sum(axis=0), c2 - p.kappa, rtol=1e-7)
    np.testing.assert_allclose(p.mu @ p.inverse_covariance @ e, c2 - p.kappa, rtol=1e-7)
    d, tau = d_ray(p, e)
    np.testing.assert_allclose(tau, 1.0, rtol=1e-7)
    np.testing.assert_allclose(d, p.kappa, rtol=1e-5)


@pytest.mark.parametrize("seed", SEEDS)
def test_the_quad_encloses_the_support(seed: int) -> None:
    p = random_primitive(seed)
    corners, z_ray = quad(p)
    # The quad's plane holds c²/(c² − κ) E; in its own coordinates E is the circle of radius √κ / b, and the square
    # from −√κ/b to √κ/b touches it on each side. Corners are never in the support; nor is anything on the sides but
    # where they touch.
    for t in np.linspace(0.0, 1.0, 17):
        sides = (1.0 - t) * corners + t * np.roll(corners, -1, axis=1)
        d, tau = d_ray(p, sides)
        assert (d >= p.kappa * (1.0 - 1e-6)).all()
        assert (tau > 0).all()
    scaled = phi_inverse(p, CIRCLE) * p.c**2 / (p.c**2 - p.kappa)
    edges = np.stack([corners[:, 1] - corners[:, 0], corners[:, 3] - corners[:, 0]])
    # Solved in whitened space, where a needle is round.
    white = (p.r_p.T @ np.column_stack([edges[0], edges[1], scaled - corners[:, :1]])) / p.s[:, None]
    inside = np.linalg.lstsq(white[:, :2], white[:, 2:], rcond=None)[0]
    assert inside.min() > -1e-6
    assert inside.max() < 1.0 + 1e-6
    assert np.abs(z_ray).min() == pytest.approx(np.sqrt(p.kappa) / p.b)


@pytest.mark.parametrize("closeness", [None, 1e-4, 1e-2])
@pytest.mark.parametrize("seed", SEEDS)
def test_eq_16_is_eq_5(seed: int, closeness: float | None) -> None:
    """Random rays through the quad; with `closeness` the camera grazes the support's boundary from outside."""
    p = random_primitive(seed, closeness)
    corners, z_ray = quad(p)
    weights = np.random.default_rng(seed).dirichlet(np.ones(4), 40).T
    d, _ = d_ray(p, corners @ weights)
    np.testing.assert_allclose(divergence_on_quad(p.c, z_ray @ weights), d, rtol=1e-5, atol=1e-9)


@pytest.mark.parametrize("seed", SEEDS)
def test_a_camera_inside_sees_the_primitive_everywhere(seed: int) -> None:
    """Prop. A.2: why c² <= κ is skipped."""
    p = random_primitive(seed, -0.5)
    rays = np.random.default_rng(seed).normal(size=(3, 200))
    assert (d_ray(p, rays)[0] <= p.kappa * (1 + 1e-9)).all()


def test_the_mip_factor_is_the_ratio_of_areas_and_has_its_limits() -> None:
    rng = np.random.default_rng(1)
    scale = 10.0 ** (rng.uniform(-6, 6, (200, 1)) + rng.uniform(-4, 0, (200, 3)))
    towards = rng.normal(size=(200, 3))
    assert mip_modulation(scale, scale, towards) == pytest.approx(np.ones(200))
    # A filter far larger than the primitive: the factor is the area across the ray over the filter's area.
    sigma = scale.max(axis=1, keepdims=True) * 1e4
    unit = towards / np.linalg.norm(towards, axis=1, keepdims=True)
    for k in range(200):
        frame = np.linalg.svd(unit[k : k + 1])[2][1:]
        area = np.linalg.norm(np.cross(*(frame * scale[k])))  # √det of the marginal across the ray
        factor = mip_modulation(scale[k : k + 1], np.hypot(scale[k : k + 1], sigma[k]), towards[k : k + 1])[0]
        assert factor == pytest.approx(area / sigma[k, 0] ** 2, rel=1e-6)
        assert 0 < factor <= 1
    # A filter far smaller changes nothing.
    small = scale.min(axis=1, keepdims=True) * 1e-6
    assert mip_modulation(scale, np.hypot(scale, small), towards) == pytest.approx(np.ones(200))


def test_mip_opacity_keeps_its_integral() -> None:
    """Eq. 17 for a primitive near the axis: the sum of ω over pixels is that of the unfiltered primitive."""
    camera = PlainCamera(width=64, height=64, cx=32, cy=32, fx=300, fy=300)
    scene = scene_of(cloud_of([[0.0, 0.0, 5.0]], scale=(0.04, 0.06, 0.05), opacity=0.4))
    plain = render(scene, camera, alpha_min=1e-6, supersampling=2).rgba[..., 3].sum()
    mip = render(scene, camera, alpha_min=1e-6, dilation_px2=0.5, antialiased=True).rgba[..., 3].sum()
    assert mip == pytest.approx(plain, rel=2e-3)


def test_the_oracles_boxes_lose_nothing() -> None:
    rng = np.random.default_rng(5)
    position = rng.normal(size=(40, 3)) * [1.5, 1.5, 1.0] + [0, 0, 1.5]
    scene = scene_of(cloud_of(position, scale=10.0 ** rng.uniform(-3, 0, (40, 3)), rotation=rng.normal(size=(40, 4))))
    for projection, fx in (("pinhole", 20.0), ("orthographic", 15.0)):
        camera = PlainCamera(fx=fx, fy=fx, projection=projection)
        np.testing.assert_allclose(render(scene, camera).rgba, render(scene, camera, everywhere=True).rgba, atol=1e-12)


def test_one_primitive_on_the_axis_is_a_gaussian_of_the_rays_slope() -> None:
    """Closed form: an isotropic primitive at distance z has D = (z/s)² sin²θ."""
    camera = PlainCamera()
    scene = scene_of(cloud_of([[0.0, 0.0, 4.0]], scale=0.5, opacity=0.9, rgb=(1.0, 1.0, 1.0)))
    slope2 = (pixel_rays(camera, 1)[1][..., :2] ** 2).sum(axis=-1)
    omega = 0.9 * np.exp(-0.5 * (4.0 / 0.5) ** 2 * slope2 / (1.0 + slope2))
    np.testing.assert_allclose(render(scene, camera).rgba[..., 3], np.where(omega < 1 / 255, 0, omega), atol=1e-12)


def test_what_surrounds_the_camera_is_skipped() -> None:
    cloud = cloud_of([[0.0, 0.0, 1.0], [0.0, 0.0, 1.0]], scale=[[5.0] * 3, [0.1] * 3])
    assert len(gather(scene_of(cloud), PlainCamera()).mean) == 1
