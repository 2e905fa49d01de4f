// SPDX-License-Identifier: GPL-3.0-or-later
//
// Counter-based random numbers, as engine/maths/random.py: pcg3d of Jarzynski and Olano, "Hash Functions for GPU
// Rendering" (JCGT 9(3), 2020).

uvec3 pcg3d(uvec3 v) {
  v = v * 1664525u + 1013904223u;
  v.x += v.y * v.z;
  v.y += v.z * v.x;
  v.z += v.x * v.y;
  v ^= v >> 16u;
  v.x += v.y * v.z;
  v.y += v.z * v.x;
  v.z += v.x * v.y;
  return v;
}

float uniform_number(uvec3 key) { // in (0, 1), evenly spaced by 2^-24
  return (float(pcg3d(key).x >> 8u) + 0.5) * (1.0 / 16777216.0);
}
