# SPDX-License-Identifier: GPL-3.0-or-later
"""`raygs.py` against `raygs.glsl`, value by value, and against the float64 derivation and Eq. 5."""

from __future__ import annotations

import numpy as np
import pytest
import warp as wp
from scipy.spatial.transform import Rotation

from stipple.engine.device import choose_device, launch
from stipple.engine.rays import raygs
from stipple.engine.renderer import Renderer
from tests.oracle.rays import divergence
from tests.oracle.rays_steps import Primitive, principal_directions, quad, rotation_to
from tests.render.quads import P_MIN, Asked, beside_kernel, in_glsl, in_warp, meet_kernel, random_questions


def ellipse(found: np.ndarray) -> np.ndarray:
    """(N, 3, 3) q0 q0ᵀ + q1 q1ᵀ: the ellipse whose axes they are, whatever their signs; a circle has many."""
    q = np.stack([found["q0"], found["q1"]], axis=-1).astype(np.float64)
    return q @ np.swapaxes(q, 1, 2)


def differences(found: np.ndarray, wanted: np.ndarray) -> dict[str, np.ndarray]:
    """Relative differences of what both call visible."""
    both = found["visible"] & wanted["visible"]
    mine, theirs = ellipse(found[both]), ellipse(wanted[both])
    result = {"ellipse": np.abs(mine - theirs).max(axis=(1, 2)) / np.abs(theirs).max(axis=(1, 2))}
    for name in ("z_ray", "inverse_c2", "o"):
        result[name] = np.abs(found[name] - wanted[name])[both] / np.maximum(np.abs(wanted[name][both]), 1e-30)
    return result


def test_warp_computes_what_the_shader_computes(device: str, rays: Renderer) -> None:
    asked = random_questions(100_000, 1)
    found, wanted = in_warp(device, asked), in_glsl(rays, asked)
    assert 0.5 < wanted["visible"].mean() < 0.8
    assert (found["visible"] != wanted["visible"]).mean() < 1e-4  # thresholds, met within a rounding
    for name, difference in differences(found, wanted).items():
        assert np.quantile(difference, 0.99) < 3e-6, name
        assert np.quantile(difference, 0.999) < 1e-2, name  # flat splats edge-on, where the ellipse itself is unsure


def primitives(count: int, seed: int, thinnest: float = -4, farthest: float = 8) -> list[Primitive]:
    """At unit distance, axes down to 10^thinnest of each other, c² from 1.01 κ to 10^farthest κ."""
    rng = np.random.default_rng(seed)
    result = []
    for r_p in Rotation.random(count, random_state=seed).as_matrix():
        s, kappa = 10.0 ** rng.uniform(thinnest, 0, 3), rng.uniform(0.05, 11.0)
        mu_hat = rng.normal(size=3)
        mu = r_p @ (s * mu_hat / np.linalg.norm(mu_hat)) * np.sqrt(kappa * (1.0 + 10.0 ** rng.uniform(-2, farthest)))
        distance = np.linalg.norm(mu)
        result.append(Primitive(mu / distance, r_p, s / distance, kappa))
    return result


def questions_about(those: list[Primitive]) -> np.ndarray:
    asked = np.zeros(len(those), Asked.numpy_dtype())  # type: ignore[attr-defined]
    m = np.stack([p.r_p * p.s for p in those])
    asked["m0"], asked["m1"], asked["m2"] = np.moveaxis(m, 2, 0)
    asked["x"] = [p.mu for p in those]
    asked["numbers"] = [(P_MIN * np.exp(0.5 * p.kappa), 0.0, P_MIN) for p in those]
    return asked


def test_quads_are_the_derivations(device: str) -> None:
    """c, b, κ, Q and U_ray against float64. M is rounded to single precision first: needles feel that."""
    those = primitives(1000, 3)
    found = in_warp(device, questions_about(those))
    assert found["visible"].all()
    c2, kappa = np.array([(p.c**2, p.kappa) for p in those]).T
    assert np.abs(found["inverse_c2"] * c2 - 1.0).max() < 2e-3
    z_ray = np.sqrt(kappa / (1.0 - kappa / c2))
    assert (np.abs(found["z_ray"] / z_ray - 1.0) * np.minimum(1.0, c2 / kappa - 1.0)).max() < 1e-3
    axes = np.stack([p.q[:, :2] @ principal_directions(p) for p in those])  # (N, 3, 2)
    wanted = axes @ np.swapaxes(axes, 1, 2)
    difference = np.abs(ellipse(found) - wanted).max(axis=(1, 2)) / np.abs(wanted).max(axis=(1, 2))
    assert np.median(difference) < 1e-6 and difference.max() < 1e-2
    major = np.linalg.norm(axes[:, :, 1], axis=1)
    np.testing.assert_allclose(np.linalg.norm(found["q1"], axis=1), major, rtol=5e-3)
    assert np.abs((found["q0"] * found["q1"]).sum(axis=1) / major**2).max() < 1e-5  # principal: at right angles


@pytest.mark.parametrize(("thinnest", "farthest", "tolerance"), [(-1, 2, 1e-3), (-2, 4, 0.05)])
def test_rays_that_meet_a_quad_have_the_divergence_of_eq_5(
    device: str, thinnest: float, farthest: float, tolerance: float
) -> None:
    """D_ray, τ and ω of `raygs.py` for rays through random points of the quad, against their definitions.

    A ray's own rounding moves it by that much of a small and thin splat.
    """
    those = primitives(1000, 4, thinnest, farthest)
    rng = np.random.default_rng(5)
    rays, wanted = [], []
    for p in those:
        corners, _ = quad(p)
        x = corners @ rng.dirichlet(np.ones(4))
        x *= np.exp(rng.normal()) / np.linalg.norm(x)  # a ray has no length
        d, tau = divergence(p.r_p.T / p.s[:, None], p.mu, np.zeros(3), x)
        rays.append(x)
        wanted.append((d, tau, P_MIN * np.exp(0.5 * (p.kappa - d))))
    asked, held = questions_about(those), choose_device(device)
    found = wp.array(in_warp(device, asked), dtype=raygs.Quad, device=held)
    mu, x = (wp.array(np.array(v, np.float32), dtype=wp.vec3, device=held) for v in (asked["x"], rays))
    met = wp.zeros(len(those), dtype=wp.vec4, device=held)
    launch(meet_kernel, len(those), [found, mu, x, met], held)
    d, tau, omega = np.array(wanted).T
    mine = met.numpy().astype(np.float64)
    np.testing.assert_allclose(mine[:, 0], d, rtol=tolerance, atol=tolerance)
    np.testing.assert_allclose(mine[:, 1], tau, rtol=tolerance)
    np.testing.assert_allclose(mine[:, 2], omega, rtol=tolerance)


@pytest.mark.parametrize("mu_hat", [(0, 0, 1), (0, 0, -1), (1, 0, 0), (1e-4, 0, -1), (0.6, 0, 0.8), (0.6, 0, -0.8)])
def test_both_cases_of_the_rotation(device: str, mu_hat: tuple[float, float, float]) -> None:
    """A ball has q0 and q1 at right angles to μ̂ wherever it lies, behind v too (Appendix A.1)."""
    p = Primitive(np.array(mu_hat) / np.linalg.norm(mu_hat), np.eye(3), np.full(3, 0.1), 2.0)
    found = in_warp(device, questions_about([p]))[0]
    assert found["visible"]
    np.testing.assert_allclose([found["q0"] @ p.mu, found["q1"] @ p.mu], 0.0, atol=1e-7)
    np.testing.assert_allclose(ellipse(found[None])[0], 0.01 * (np.eye(3) - np.outer(p.mu, p.mu)), atol=1e-8)
    np.testing.assert_allclose(rotation_to(p.mu_hat)[:, 2], p.mu, atol=1e-12)


def test_the_skip_rules_at_their_thresholds(device: str, rays: Renderer) -> None:
    """κ <= 0, and c² <= κ: a ball at distance 1 with c² = 1 / s², just this side and just that."""
    p_min, just = np.float32(P_MIN), np.float32(1e-4)
    o = [0.0, p_min, p_min * (1 + just), 0.5, 0.5, 0.5]
    kappa = 2.0 * np.log(0.5 / p_min)
    s = [0.1, 0.1, 0.1, 1 / np.sqrt(kappa) * (1 - just), 1 / np.sqrt(kappa), 1 / np.sqrt(kappa) * (1 + just)]
    asked = questions_about([Primitive(np.array([0.0, 0.0, 1.0]), np.eye(3), np.full(3, v), 1.0) for v in s])
    asked["numbers"][:, 0] = o
    visible = [False, False, True, True, False, False]
    assert in_warp(device, asked)["visible"].tolist() == visible
    assert in_glsl(rays, asked)["visible"].tolist() == visible
    asked["how"][:, 2] = 1  # parallel rays: no camera is inside
    assert in_warp(device, asked)["visible"].tolist() == [False, False, True, True, True, True]
    asked["how"][:, 1:] = 1, 0  # Eq. 17: no filter changes nothing; a wide one leaves nothing
    assert in_warp(device, asked)["visible"].tolist() == visible
    asked["numbers"][:, 1] = 1e3
    assert not in_warp(device, asked)["visible"].any()


@pytest.mark.parametrize("nonsense", [np.nan, np.inf, -np.inf, 0.0, 1e30, -1e30, 3e38])
def test_nonsense_makes_no_quad_with_a_nan(device: str, rays: Renderer, nonsense: float) -> None:
    """In each number alone, in both languages; and what is NaN or infinite in M or x is no quad."""
    names = ("m0", "m1", "m2", "x", "numbers")
    asked = np.repeat(random_questions(40, 6), 3 * len(names))
    places = np.tile(np.arange(3 * len(names)), 40)
    for row, place in zip(asked, places, strict=True):
        if place != 14:  # p_min comes from the settings
            row[names[place // 3]][place % 3] = nonsense
    for found in (in_warp(device, asked), in_glsl(rays, asked)):
        numbers = np.column_stack([found["q0"], found["q1"], found["z_ray"], found["inverse_c2"], found["o"]])
        assert not np.isnan(numbers).any()
        if np.isnan(nonsense):
            assert not found["visible"][places < 12].any()


def planes_touching(drawn: np.ndarray, asked: np.ndarray, larger: float) -> np.ndarray:
    """(N, 4) planes beyond which all of each support lies, that touch it somewhere, were it `larger` times as large.

    Through the eye, or along the rays where those are parallel.
    """
    phi = np.random.default_rng(8).uniform(0.0, 2.0 * np.pi, (len(drawn), 1))
    q0, q1, mu = (v.astype(np.float64) for v in (drawn["q0"], drawn["q1"], asked["x"]))
    z = larger * drawn["z_ray"][:, None].astype(np.float64)
    edge = mu + z * (q0 * np.cos(phi) + q1 * np.sin(phi))
    along = np.where(asked["how"][:, 2:] != 0, [0.0, 0.0, 1.0], edge)
    n = np.cross(along, q1 * np.cos(phi) - q0 * np.sin(phi))
    n /= np.maximum(np.linalg.norm(n, axis=1, keepdims=True), 1e-30)
    n *= -np.sign(((mu - edge) * n).sum(axis=1, keepdims=True))
    return np.column_stack([n, -(edge * n).sum(axis=1)])


def test_culling_allows_for_every_rounding(device: str, rays: Renderer) -> None:
    """A plane that touches the shader's support culls nothing; one a twentieth farther out mostly does.

    Whatever the shape: among them are discs seen edge-on, whose ellipses the two languages do not agree about.
    """
    asked = random_questions(200_000, 7)
    asked["how"][:, 1] = 0  # Eq. 17 only makes supports smaller
    drawn = in_glsl(rays, asked)
    held, visible = choose_device(device), drawn["visible"]
    beside = wp.zeros(len(asked), dtype=wp.bool, device=held)
    for larger, shift in ((1.0, 1e-6), (1.05, 0.0)):  # a millionth of the distance for the plane's own rounding
        planes = planes_touching(drawn, asked, larger).astype(np.float32)
        planes[:, 3] += shift
        inputs = [wp.array(asked, dtype=Asked, device=held), wp.array(planes, dtype=wp.vec4, device=held), beside]
        launch(beside_kernel, len(asked), inputs, held)
        culled = beside.numpy()[visible]
        assert not culled.any() if larger == 1.0 else culled.mean() > 0.7
