// SPDX-License-Identifier: GPL-3.0-or-later
//
// From a primitive in camera space to its quad (Rota Bulò et al., "Hardware-Rasterized Ray-Based Gaussian Splatting",
// sections 3.2, 4.1, 5). Names are the paper's. Lengths are in units of the mean's distance (orthographic: of a
// pixel), which no ray's divergence depends on, so that single precision serves scenes of any size. The same in Warp,
// function by function: raygs.py.

const float LEAST_S = 1e-9;  // a flatter primitive is raised to this, so that S has an inverse
const float LARGEST_S = 1e7; // a larger one is level over any picture
const float LEAST_SPARE = 1e-6; // of c^2 over kappa: nearer than this the quad's size is rounding

// One step of one-sided Jacobi: makes two columns orthogonal by rotating them into each other.
void make_orthogonal(inout vec3 p, inout vec3 q) {
  float pp = dot(p, p);
  float qq = dot(q, q);
  float pq = dot(p, q);
  if (!(abs(pq) > 1e-7 * sqrt(pp) * sqrt(qq))) {
    return;
  }
  float zeta = (qq - pp) / (2.0 * pq);
  float t = (zeta >= 0.0 ? 1.0 : -1.0) / (abs(zeta) + sqrt(1.0 + zeta * zeta));
  float cosine = 1.0 / sqrt(1.0 + t * t);
  vec3 turned = cosine * (p - t * q);
  q = cosine * (q + t * p);
  p = turned;
}

void longer_first(inout vec3 p, inout vec3 q) {
  if (dot(q, q) > dot(p, p)) {
    vec3 held = p;
    p = q;
    q = held;
  }
}

// R_p and S with R_p S^2 R_p^T = M M^T (section 3), the largest first. The columns of M are orthogonal already unless
// an instance is sheared or scaled unevenly; then Jacobi's rotations, some `sweeps` of them, make them so to full
// relative accuracy, needles included.
void principal_axes(mat3 M, int sweeps, out mat3 R_p, out vec3 S) {
  vec3 w0 = M[0];
  vec3 w1 = M[1];
  vec3 w2 = M[2];
  for (int sweep = 0; sweep < sweeps; sweep++) {
    make_orthogonal(w0, w1);
    make_orthogonal(w0, w2);
    make_orthogonal(w1, w2);
  }
  longer_first(w0, w1);
  longer_first(w0, w2);
  longer_first(w1, w2);
  S = clamp(vec3(length(w0), length(w1), length(w2)), LEAST_S, LARGEST_S);
  R_p[0] = length(w0) > 0.0 ? normalize(w0) : vec3(1.0, 0.0, 0.0);
  vec3 across = w1 - R_p[0] * dot(R_p[0], w1);
  if (!(length(across) > 1e-9 * length(w0))) { // a needle of no width: any direction across will do
    vec3 other = abs(R_p[0].x) < 0.7 ? vec3(1.0, 0.0, 0.0) : vec3(0.0, 1.0, 0.0);
    across = cross(R_p[0], other);
  }
  R_p[1] = normalize(across);
  R_p[2] = cross(R_p[0], R_p[1]);
}

// The half turn about x + y, which takes y to x (Appendix A.1).
mat3 R_half_turn(vec3 x, vec3 y) {
  vec3 axis = normalize(x + y);
  return 2.0 * outerProduct(axis, axis) - mat3(1.0);
}

// R_{mu_hat <- v} with v = (0, 0, 1), in both its cases (Appendix A.1).
mat3 R_mu_hat_from_v(vec3 mu_hat) {
  vec3 v = vec3(0.0, 0.0, 1.0);
  if (mu_hat.z >= 0.0) {
    return R_half_turn(mu_hat, v);
  }
  mat3 P = mat3(vec3(-1.0, 0.0, 0.0), vec3(0.0, 1.0, 0.0), vec3(0.0, 0.0, -1.0));
  return R_half_turn(mu_hat, -v) * P;
}

// U_ray = (u0, u1) of Eq. 14 (Appendix A.2): u1 the eigenvector of B with the larger eigenvalue, u0 a quarter turn on.
mat2 principal_directions(vec3 q0, vec3 q1) {
  float half_difference = 0.5 * (dot(q0, q0) - dot(q1, q1));
  float b01 = dot(q0, q1);
  float radius = sqrt(half_difference * half_difference + b01 * b01);
  vec2 u1 = half_difference >= 0.0 ? vec2(radius + half_difference, b01) : vec2(b01, radius - half_difference);
  float size = length(u1);
  u1 = size > 0.0 ? u1 / size : vec2(0.0, 1.0); // a circle: every direction is principal
  return mat2(vec2(-u1.y, u1.x), u1);
}

// The factor of Eq. 17 under its root is |S|^2 c^2 before over after the filter, the squared area across the ray (Prop.
// A.6); written as a sum of products it has no inverse, so a flat disc is no special case. `towards` is mu in principal
// axes, of any length.
float squared_area_across(vec3 S, vec3 towards) {
  vec3 s = S * S;
  vec3 m = towards * towards;
  return m.x * s.y * s.z + m.y * s.z * s.x + m.z * s.x * s.y;
}

struct Quad {
  vec3 q0;          // Q_{0:2} U_ray, the first two columns of T_ray (Eq. 15)
  vec3 q1;
  float z_ray;      // sqrt(kappa) / b, half the side of the square Z_ray
  float inverse_c2; // c^-2
  float o;          // prior opacity, modulated
  bool visible;
};

// Eq. 15 for a primitive with mean mu and covariance M M^T. `x` is the ray through the mean: mu itself in pinhole
// cameras; the view direction in orthographic ones, which are `parallel`, where c is infinite.
//
// All that this rests on is shown for c^2 > kappa. The points of maximum density (Prop. A.1) on the support's boundary,
// scaled to tau = 1 (Prop. A.3: there tau is never 0; Prop. A.4), lie in one plane: e^T Sigma^-1 mu = c^2 - kappa (Prop.
// A.5, Eq. 8), and on an ellipse there, which Phi maps to the unit circle (Eq. 9 to 12). The quad is the ellipse's
// rectangle (Eq. 13, 14), scaled by c^2 / (c^2 - kappa), so that it goes through mu: V^T Sigma^-1 mu = c^2.
Quad quad_of(
    vec3 x, mat3 M, int sweeps, float o, float filter_variance, float p_min, bool modulate, bool parallel) {
  Quad quad;
  quad.visible = false;
  float sizes = dot(M[0], M[0]) + dot(M[1], M[1]) + dot(M[2], M[2]) + dot(x, x) + filter_variance;
  if (!(sizes < 1e16)) { // what is no number is not seen; honest M end at LARGEST_S
    return quad;
  }
  mat3 R_p;
  vec3 S;
  principal_axes(M, sweeps, R_p, S);
  vec3 towards = x * R_p; // R_p^T x
  vec3 S_hat = sqrt(S * S + filter_variance);
  quad.o = o;
  if (modulate) { // Eq. 17 (Appendix A.5)
    quad.o *= sqrt(squared_area_across(S, towards) / squared_area_across(S_hat, towards));
  }
  if (!(quad.o > p_min)) { // kappa <= 0: the support is empty (section 3)
    return quad;
  }
  float kappa = -2.0 * log(p_min / quad.o); // below Eq. 3
  vec3 c_mu_hat = towards / S_hat;
  float c = length(c_mu_hat); // Eq. 6
  quad.inverse_c2 = parallel ? 0.0 : 1.0 / (c * c);
  float b2 = 1.0 - kappa * quad.inverse_c2; // b^2 of Eq. 9, from Prop. A.5
  if (!(c > 0.0 && b2 > LEAST_SPARE)) { // c^2 <= kappa: the camera is inside, the support is everywhere (Prop. A.2)
    return quad;
  }
  mat3 R = R_mu_hat_from_v(c_mu_hat / c);
  vec3 q0 = R_p * (S_hat * R[0]); // Q = R_p S R_{mu_hat <- v} (Eq. 12)
  vec3 q1 = R_p * (S_hat * R[1]);
  mat2 U_ray = principal_directions(q0, q1);
  quad.q0 = q0 * U_ray[0].x + q1 * U_ray[0].y;
  quad.q1 = q0 * U_ray[1].x + q1 * U_ray[1].y;
  quad.z_ray = sqrt(kappa / b2);
  quad.visible = true;
  return quad;
}
