// SPDX-License-Identifier: GPL-3.0-or-later
//
// Opacity of one splat on one pixel's ray (RayGS, section 4.2, Appendix A.4). Sorted: blended over what is farther.
// Stochastic: kept with the probability of its opacity, and then opaque. raygs.py has tau, D_ray and omega in Warp.

void main() {
  float z2 = dot(quad_point.xy, quad_point.xy);
  // Of a point x on the quad, where x^T Sigma^-1 mu = c^2 (Prop. A.5, scaled): then tau = c^2 / x^T Sigma^-1 x, and that
  // is 1 - D_ray / c^2 (Appendix A.4, step b). Above 0 for what is in front of the camera (Prop. A.3: never 0).
  float tau = 1.0 / (1.0 + z2 * inverse_c2);
  float D_ray = z2 * tau;                    // Eq. 16, multiplied out so that z = 0 divides nothing
  float omega = radiance.w * exp(-0.5 * D_ray); // Eq. 2
  if (!(omega >= cut.x)) { // outside the support (Eq. 3); a NaN is outside
    discard;
  }
  float unclamped = omega;
  omega = min(omega, radiance.w < cut.z ? cut.y : 1.0);
  float depth = quad_point.z * tau; // of the point of maximum density (Prop. A.1)
#ifdef STOCHASTIC
  uvec2 pixel = uvec2(gl_FragCoord.xy + window.xy);
  if (uniform_number(uvec3(pixel.x | (pixel.y << 16u), random_key)) > omega) {
    discard;
  }
  omega = 1.0;
  // 64 octaves of depth, each with the same share of the depth buffer.
  gl_FragDepth = clamp((log2(max(depth, 1e-30)) + 32.0) / 64.0, 0.0, 1.0);
#endif
  out_colour = vec4(radiance.xyz * omega, omega);
  if (radiance.w >= cut.w) {
    // D_ray once more, from Eq. 2: a second use of it itself would change the rounding of everybody's exp.
    out_colour.xyz *= max(1.0 + 2.0 * SHADE_SLOPE * log(unclamped / radiance.w), RIM_SHADE);
  }
  out_depth = vec4(depth * omega, 0.0, 0.0, omega);
}
