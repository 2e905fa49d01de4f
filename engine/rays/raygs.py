# SPDX-License-Identifier: GPL-3.0-or-later
"""`raygs.glsl` in Warp, function by function in the same order, and Eq. 2, 5 and 16 of `fragment.glsl`.

From a primitive in camera space to its quad (Rota Bulò et al., "Hardware-Rasterized Ray-Based Gaussian Splatting",
sections 3.2, 4.1, 5). Names are the paper's. Lengths are in units of the mean's distance (orthographic: of a pixel),
which no ray's divergence depends on, so that single precision serves scenes of any size.

The shaders draw with the one, culling (`support`) and picking compute with the other; a test holds them together, value
by value. GLSL's matrices are made of columns and so are these: column k of `M` there is `column(M, k)` here. What GLSL
hands back through `out` and `inout` is returned.
"""

from __future__ import annotations

import warp as wp

wp.set_module_options({"enable_backward": False})

LEAST_S = wp.constant(1e-9)  # a flatter primitive is raised to this, so that S has an inverse
LARGEST_S = wp.constant(1e7)  # a larger one is level over any picture
LEAST_SPARE = wp.constant(1e-6)  # of c² over κ: nearer than this the quad's size is rounding


@wp.func
def column(matrix: wp.mat33, k: int) -> wp.vec3:
    return wp.vec3(matrix[0, k], matrix[1, k], matrix[2, k])


@wp.func
def make_orthogonal(p: wp.vec3, q: wp.vec3) -> tuple[wp.vec3, wp.vec3]:
    """One step of one-sided Jacobi: two columns, rotated into each other so that they are orthogonal."""
    pp = wp.dot(p, p)
    qq = wp.dot(q, q)
    pq = wp.dot(p, q)
    if not wp.abs(pq) > 1e-7 * wp.sqrt(pp) * wp.sqrt(qq):
        return p, q
    zeta = (qq - pp) / (2.0 * pq)
    t = wp.where(zeta >= 0.0, 1.0, -1.0) / (wp.abs(zeta) + wp.sqrt(1.0 + zeta * zeta))
    cosine = 1.0 / wp.sqrt(1.0 + t * t)
    return cosine * (p - t * q), cosine * (q + t * p)


@wp.func
def longer_first(p: wp.vec3, q: wp.vec3) -> tuple[wp.vec3, wp.vec3]:
    if wp.dot(q, q) > wp.dot(p, p):
        return q, p
    return p, q


@wp.func
def principal_axes(M: wp.mat33, sweeps: wp.int32) -> tuple[wp.mat33, wp.vec3]:
    """R_p and S with R_p S² R_pᵀ = M Mᵀ (section 3), the largest first.

    The columns of M are orthogonal already unless an instance is sheared or scaled unevenly; then Jacobi's rotations,
    some `sweeps` of them, make them so to full relative accuracy, needles included.
    """
    w0 = column(M, 0)
    w1 = column(M, 1)
    w2 = column(M, 2)
    for _ in range(sweeps):
        w0, w1 = make_orthogonal(w0, w1)
        w0, w2 = make_orthogonal(w0, w2)
        w1, w2 = make_orthogonal(w1, w2)
    w0, w1 = longer_first(w0, w1)
    w0, w2 = longer_first(w0, w2)
    w1, w2 = longer_first(w1, w2)
    S = wp.vec3(
        wp.clamp(wp.length(w0), LEAST_S, LARGEST_S),
        wp.clamp(wp.length(w1), LEAST_S, LARGEST_S),
        wp.clamp(wp.length(w2), LEAST_S, LARGEST_S),
    )
    r0 = wp.vec3(1.0, 0.0, 0.0)
    if wp.length(w0) > 0.0:
        r0 = wp.normalize(w0)
    across = w1 - r0 * wp.dot(r0, w1)
    if not wp.length(across) > 1e-9 * wp.length(w0):  # a needle of no width: any direction across will do
        other = wp.where(wp.abs(r0[0]) < 0.7, wp.vec3(1.0, 0.0, 0.0), wp.vec3(0.0, 1.0, 0.0))
        across = wp.cross(r0, other)
    r1 = wp.normalize(across)
    return wp.matrix_from_cols(r0, r1, wp.cross(r0, r1)), S


@wp.func
def R_half_turn(x: wp.vec3, y: wp.vec3) -> wp.mat33:
    """The half turn about x + y, which takes y to x (Appendix A.1)."""
    axis = wp.normalize(x + y)
    return 2.0 * wp.outer(axis, axis) - wp.identity(n=3, dtype=wp.float32)


@wp.func
def R_mu_hat_from_v(mu_hat: wp.vec3) -> wp.mat33:
    """R_{μ̂←v} with v = (0, 0, 1), in both its cases (Appendix A.1)."""
    v = wp.vec3(0.0, 0.0, 1.0)
    if mu_hat[2] >= 0.0:
        return R_half_turn(mu_hat, v)
    P = wp.diag(wp.vec3(-1.0, 1.0, -1.0))
    return R_half_turn(mu_hat, -v) * P


@wp.func
def principal_directions(q0: wp.vec3, q1: wp.vec3) -> wp.mat22:
    """U_ray = (u0, u1) of Eq. 14 (Appendix A.2): u1 the eigenvector of B with the larger eigenvalue, u0 a turn on."""
    half_difference = 0.5 * (wp.dot(q0, q0) - wp.dot(q1, q1))
    b01 = wp.dot(q0, q1)
    radius = wp.sqrt(half_difference * half_difference + b01 * b01)
    u1 = wp.vec2(b01, radius - half_difference)
    if half_difference >= 0.0:
        u1 = wp.vec2(radius + half_difference, b01)
    size = wp.length(u1)
    u1 = wp.where(size > 0.0, u1 / size, wp.vec2(0.0, 1.0))  # a circle: every direction is principal
    return wp.matrix_from_cols(wp.vec2(-u1[1], u1[0]), u1)


@wp.func
def squared_area_across(S: wp.vec3, towards: wp.vec3) -> wp.float32:
    """|S|² c² of Eq. 17, the squared area across the ray (Prop. A.6), times the squared length of `towards`.

    Written as a sum of products it has no inverse, so a flat disc is no special case.
    `towards` is μ in principal axes, of any length.
    """
    s = wp.cw_mul(S, S)
    m = wp.cw_mul(towards, towards)
    return m[0] * s[1] * s[2] + m[1] * s[2] * s[0] + m[2] * s[0] * s[1]


@wp.struct
class Quad:
    q0: wp.vec3  # Q_{0:2} U_ray, the first two columns of T_ray (Eq. 15)
    q1: wp.vec3
    z_ray: wp.float32  # √κ / b, half the side of the square Z_ray
    inverse_c2: wp.float32  # c⁻²
    o: wp.float32  # prior opacity, modulated
    visible: wp.bool


@wp.func
def quad_of(
    x: wp.vec3,
    M: wp.mat33,
    sweeps: wp.int32,
    o: wp.float32,
    filter_variance: wp.float32,
    p_min: wp.float32,
    modulate: wp.bool,
    parallel: wp.bool,
) -> Quad:
    """Eq. 15 for a primitive with mean μ and covariance M Mᵀ.

    `x` is the ray through the mean: μ itself in pinhole cameras; the view direction in orthographic ones, which are
    `parallel`, where c is infinite. All is 0 of a quad that is not visible, and no number is a NaN.

    All that this rests on is shown for c² > κ. The points of maximum density (Prop. A.1) on the support's boundary,
    scaled to τ = 1 (Prop. A.3: there τ is never 0; Prop. A.4), lie in one plane: eᵀ Σ⁻¹ μ = c² − κ (Prop. A.5, Eq. 8),
    and on an ellipse there, which Φ maps to the unit circle (Eq. 9 to 12). The quad is the ellipse's rectangle (Eq. 13,
    14), scaled by c² / (c² − κ), so that it goes through μ: Vᵀ Σ⁻¹ μ = c².
    """
    quad = Quad()
    sizes = wp.ddot(M, M) + wp.dot(x, x) + filter_variance
    if not sizes < 1e16:  # what is no number is not seen; honest M end at LARGEST_S
        return quad
    R_p, S = principal_axes(M, sweeps)
    towards = wp.transpose(R_p) * x
    S_hat = wp.vec3(
        wp.sqrt(S[0] * S[0] + filter_variance),
        wp.sqrt(S[1] * S[1] + filter_variance),
        wp.sqrt(S[2] * S[2] + filter_variance),
    )
    quad.o = o
    if modulate:  # Eq. 17 (Appendix A.5)
        quad.o *= wp.sqrt(squared_area_across(S, towards) / squared_area_across(S_hat, towards))
    if not quad.o > p_min:  # κ <= 0: the support is empty (section 3)
        return Quad()
    kappa = -2.0 * wp.log(p_min / quad.o)  # below Eq. 3
    c_mu_hat = wp.cw_div(towards, S_hat)
    c = wp.length(c_mu_hat)  # Eq. 6
    quad.inverse_c2 = wp.where(parallel, 0.0, 1.0 / (c * c))
    b2 = 1.0 - kappa * quad.inverse_c2  # b² of Eq. 9, from Prop. A.5
    if not (c > 0.0 and b2 > LEAST_SPARE):  # c² <= κ: the camera is inside, the support is everywhere (Prop. A.2)
        return Quad()
    R = R_mu_hat_from_v(c_mu_hat / c)
    q0 = R_p * wp.cw_mul(S_hat, column(R, 0))  # Q = R_p S R_{μ̂←v} (Eq. 12)
    q1 = R_p * wp.cw_mul(S_hat, column(R, 1))
    U_ray = principal_directions(q0, q1)
    quad.q0 = q0 * U_ray[0, 0] + q1 * U_ray[1, 0]
    quad.q1 = q0 * U_ray[0, 1] + q1 * U_ray[1, 1]
    quad.z_ray = wp.sqrt(kappa / b2)
    quad.visible = True
    return quad


@wp.func
def on_quad(quad: Quad, mu: wp.vec3, origin: wp.vec3, x: wp.vec3) -> wp.vec3:
    """Where the ray origin + λ x meets the quad's plane: Z_ray α and λ. The hardware finds it by interpolation.

    T_ray H(z) = origin + λ x (Eq. 15) for z and λ; q0 and q1 are orthogonal, being principal (Eq. 14).
    """
    normal = wp.cross(wp.normalize(quad.q0), wp.normalize(quad.q1))
    along = wp.dot(normal, mu - origin) / wp.dot(normal, x)
    v = origin + along * x - mu
    return wp.vec3(wp.dot(v, quad.q0) / wp.dot(quad.q0, quad.q0), wp.dot(v, quad.q1) / wp.dot(quad.q1, quad.q1), along)


@wp.func
def tau_on_quad(z2: wp.float32, inverse_c2: wp.float32) -> wp.float32:
    """τ (Eq. 5, Prop. A.1) of a point x of the quad with ‖Z_ray α‖² = `z2`.

    There xᵀ Σ⁻¹ μ = c² (Prop. A.5, scaled): then τ = c² / xᵀ Σ⁻¹ x, and that is 1 − D_ray / c² (Appendix A.4, step b).
    """
    return 1.0 / (1.0 + z2 * inverse_c2)


@wp.func
def D_ray(z2: wp.float32, inverse_c2: wp.float32) -> wp.float32:
    """Eq. 16 (Appendix A.4), multiplied out so that z = 0 divides nothing."""
    return z2 * tau_on_quad(z2, inverse_c2)


@wp.func
def omega(o: wp.float32, divergence: wp.float32) -> wp.float32:
    """Eq. 2."""
    return o * wp.exp(-0.5 * divergence)
