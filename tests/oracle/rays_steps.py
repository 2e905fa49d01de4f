# SPDX-License-Identifier: GPL-3.0-or-later
"""The derivation of the RayGS quad (§4.1, §4.2, Appendix A), one function per step, in float64.

The paper's Eq. 15 writes T_ray := [Q_{0:2} U_ray, μ̂]; its own Appendix A.3, step (e), needs c R_p S μ̂ = μ in the last
column, and only μ puts the quad where Φ⁻¹ does. μ is used here.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .scene_like import Float64Array

CANONICAL_QUAD = np.array([[-1.0, -1.0, 1.0, 1.0], [-1.0, 1.0, 1.0, -1.0]])  # O, below Eq. 7
V_AXIS = np.array([0.0, 0.0, 1.0])  # v


@dataclass(frozen=True, eq=False)
class Primitive:
    """A primitive in camera space: mean μ (3,), rotation R_p (3, 3), scales S (3,), cut-off κ."""

    mu: Float64Array
    r_p: Float64Array
    s: Float64Array
    kappa: float

    @property
    def inverse_covariance(self) -> Float64Array:
        return np.asarray((self.r_p / self.s**2) @ self.r_p.T)

    @property
    def whitened_mean(self) -> Float64Array:
        """S⁻¹ R_pᵀ μ = c μ̂."""
        return np.asarray((self.r_p.T @ self.mu) / self.s)

    @property
    def c(self) -> float:
        """Eq. 6."""
        return float(np.linalg.norm(self.whitened_mean))

    @property
    def mu_hat(self) -> Float64Array:
        return self.whitened_mean / self.c

    @property
    def a(self) -> float:
        """Below Eq. 11."""
        return float(np.sqrt(self.kappa / (self.c**2 - self.kappa)))

    @property
    def b(self) -> float:
        """Eq. 9."""
        return float(np.sqrt(1.0 - self.kappa / self.c**2))

    @property
    def q(self) -> Float64Array:
        """Q of Eq. 12."""
        return np.asarray(self.r_p @ (self.s[:, None] * rotation_to(self.mu_hat)))


def half_turn(x: Float64Array, y: Float64Array) -> Float64Array:
    """R_{x,y} of Appendix A.1: the half turn about x + y, which takes y to x."""
    axis = x + y
    return np.asarray(2.0 * np.outer(axis, axis) / (axis @ axis) - np.eye(3))


def rotation_to(mu_hat: Float64Array) -> Float64Array:
    """R_{μ̂←v} of Appendix A.1, in both its cases."""
    if mu_hat @ V_AXIS >= 0:
        return half_turn(mu_hat, V_AXIS)
    return np.asarray(half_turn(mu_hat, -V_AXIS) @ np.diag([-1.0, 1.0, -1.0]))


def homogeneous(u: Float64Array) -> Float64Array:
    """H: (2, N) to (3, N) with ones below."""
    return np.vstack([u, np.ones((1, u.shape[1]))])


def phi_inverse(primitive: Primitive, u: Float64Array) -> Float64Array:
    """Eq. 12: points of the unit disc (2, N) to the plane of the ellipse E, (3, N)."""
    factor = (primitive.c**2 - primitive.kappa) / primitive.c
    return np.asarray(factor * primitive.q @ homogeneous(primitive.a * u))


def phi(primitive: Primitive, e: Float64Array) -> Float64Array:
    """The chain E → ê → ē → u of §4.1: (3, N) to (2, N), on the unit circle."""
    e_hat = (primitive.r_p.T @ e) / primitive.s[:, None] / np.sqrt(primitive.c**2 - primitive.kappa)
    e_bar = rotation_to(primitive.mu_hat).T @ e_hat
    return np.asarray(e_bar[:2] / (primitive.b * primitive.a))


def principal_directions(primitive: Primitive) -> Float64Array:
    """U_ray = (u0, u1) of Eq. 14: u1 along the ellipse's major axis, u0 a quarter turn on."""
    q = primitive.q[:, :2]
    u1 = np.linalg.eigh(q.T @ q)[1][:, 1]
    return np.stack([np.array([-u1[1], u1[0]]), u1], axis=1)


def quad(primitive: Primitive) -> tuple[Float64Array, Float64Array]:
    """Eq. 15: the corners V_ray (3, 4) and what is interpolated between them, Z_ray (2, 4)."""
    z_ray = np.sqrt(primitive.kappa) / primitive.b * CANONICAL_QUAD
    t_ray = np.hstack([primitive.q[:, :2] @ principal_directions(primitive), primitive.mu[:, None]])
    return t_ray @ homogeneous(z_ray), z_ray


def divergence_on_quad(c: float, z: Float64Array) -> Float64Array:
    """Eq. 16 for interpolated z (2, N)."""
    return np.asarray(1.0 / (c**-2 + 1.0 / (z * z).sum(axis=0)))
