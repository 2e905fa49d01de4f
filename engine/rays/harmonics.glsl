// SPDX-License-Identifier: GPL-3.0-or-later
//
// Spherical harmonics, degrees 0 to 4: basis, signs and order of 3D Gaussian Splatting (engine/maths/sh.py), four
// functions at a time, as the coefficients lie in their texels. Directions run from the camera to the splat, in
// object space.

vec4 harmonics_1(vec3 d) { // band 1, first of band 2
  return vec4(0.4886025119029199 * vec3(-d.y, d.z, -d.x), 1.0925484305920792 * d.x * d.y);
}

vec4 harmonics_5(vec3 d) { // rest of band 2
  return vec4(-1.0925484305920792 * d.y * d.z,
              0.31539156525252005 * (2.0 * d.z * d.z - d.x * d.x - d.y * d.y),
              -1.0925484305920792 * d.x * d.z,
              0.5462742152960396 * (d.x * d.x - d.y * d.y));
}

vec4 harmonics_9(vec3 d) { // band 3, first four
  vec3 s = d * d;
  return vec4(-0.5900435899266435 * d.y * (3.0 * s.x - s.y),
              2.890611442640554 * d.x * d.y * d.z,
              -0.4570457994644658 * d.y * (4.0 * s.z - s.x - s.y),
              0.3731763325901154 * d.z * (2.0 * s.z - 3.0 * s.x - 3.0 * s.y));
}

vec4 harmonics_13(vec3 d) { // rest of band 3, first of band 4
  vec3 s = d * d;
  return vec4(-0.4570457994644658 * d.x * (4.0 * s.z - s.x - s.y),
              1.445305721320277 * d.z * (s.x - s.y),
              -0.5900435899266435 * d.x * (s.x - 3.0 * s.y),
              2.5033429417967046 * d.x * d.y * (s.x - s.y));
}

vec4 harmonics_17(vec3 d) { // band 4, second to fifth
  vec3 s = d * d;
  return vec4(-1.7701307697799304 * d.y * d.z * (3.0 * s.x - s.y),
              0.9461746957575601 * d.x * d.y * (7.0 * s.z - 1.0),
              -0.6690465435572892 * d.y * d.z * (7.0 * s.z - 3.0),
              0.10578554691520431 * (s.z * (35.0 * s.z - 30.0) + 3.0));
}

vec4 harmonics_21(vec3 d) { // rest of band 4
  vec3 s = d * d;
  return vec4(-0.6690465435572892 * d.x * d.z * (7.0 * s.z - 3.0),
              0.47308734787878004 * (s.x - s.y) * (7.0 * s.z - 1.0),
              -1.7701307697799304 * d.x * d.z * (s.x - 3.0 * s.y),
              0.6258357354491761 * (s.x * (s.x - 3.0 * s.y) - s.y * (3.0 * s.x - s.y)));
}
