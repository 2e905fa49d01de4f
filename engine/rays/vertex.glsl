// SPDX-License-Identifier: GPL-3.0-or-later
//
// One corner of one splat's quad (RayGS, section 4.1), and the splat's colour.

// Page, column and row of a texel in pages of equal size, row by row. Whole numbers: a float ends at 2^24.
ivec3 place_of(int texel, ivec2 size) {
  int page = texel / (size.x * size.y);
  int within = texel - page * size.x * size.y;
  return ivec3(page, within % size.x, within / size.x);
}

// Only the last page in use may be smaller than the first.
vec4 splat_texel(int index) {
  ivec2 size = textureSize(splats_0, 0);
#ifdef PAGED
  ivec3 place = place_of(index, size);
  if (place.x == 1) {
    return texelFetch(splats_1, place.yz, 0);
  }
  if (place.x == 2) {
    return texelFetch(splats_2, place.yz, 0);
  }
  if (place.x == 3) {
    return texelFetch(splats_3, place.yz, 0);
  }
  return texelFetch(splats_0, place.yz, 0);
#else
  return texelFetch(splats_0, ivec2(index % size.x, index / size.x), 0);
#endif
}

vec4 instance_texel(int index) {
  int width = textureSize(instances, 0).x;
  return texelFetch(instances, ivec2(index % width, index / width), 0);
}

// Four coefficients per channel: a texel each for red, green and blue.
vec3 weighted(int first, vec4 basis) {
  return vec3(dot(splat_texel(first), basis), dot(splat_texel(first + 1), basis), dot(splat_texel(first + 2), basis));
}

// As engine/maths/sh.py: max(0, 0.5 + sum), as trained (sRGB-encoded).
vec3 colour_towards(int record, int degree, vec3 d) {
  vec3 colour = vec3(0.5) + 0.28209479177387814 * splat_texel(record + 3).xyz;
  int first = record + 4;
  if (degree > 0) {
    colour += weighted(first, harmonics_1(d) * vec4(1.0, 1.0, 1.0, degree > 1 ? 1.0 : 0.0));
  }
  if (degree > 1) {
    colour += weighted(first + 3, harmonics_5(d));
  }
  if (degree > 2) {
    colour += weighted(first + 6, harmonics_9(d));
    colour += weighted(first + 9, harmonics_13(d) * vec4(1.0, 1.0, 1.0, degree > 3 ? 1.0 : 0.0));
  }
  if (degree > 3) {
    colour += weighted(first + 12, harmonics_17(d));
    colour += weighted(first + 15, harmonics_21(d));
  }
  // Comparisons, for a NaN fails them, and clamp may let it through; a bound, for infinity times 0 is a NaN too.
  return vec3(colour.r > 0.0 ? min(colour.r, 1e6) : 0.0,
              colour.g > 0.0 ? min(colour.g, 1e6) : 0.0,
              colour.b > 0.0 ? min(colour.b, 1e6) : 0.0);
}

float light_of(float encoded) { // the transfer functions of engine/device_look.py
  return encoded <= 0.04045 ? encoded / 12.92 : pow((encoded + 0.055) / 1.055, 2.4);
}

float encoded_of(float light) { // what is not above 0, NaN too, becomes 0
  float curve = 1.055 * pow(max(light, 0.0031308), 1.0 / 2.4) - 0.055;
  return light > 0.0 ? (light <= 0.0031308 ? light * 12.92 : curve) : 0.0;
}

vec3 graded(vec3 colour, int instance) {
  vec4 row0 = instance_texel(instance * INSTANCE_TEXELS + 6); // of the map of linear light; 1 if it is to be used
  if (row0.w == 0.0) {
    return colour;
  }
  vec3 row1 = instance_texel(instance * INSTANCE_TEXELS + 7).xyz;
  vec3 row2 = instance_texel(instance * INSTANCE_TEXELS + 8).xyz;
  vec3 light = vec3(light_of(colour.r), light_of(colour.g), light_of(colour.b));
  return vec3(encoded_of(dot(row0.xyz, light)), encoded_of(dot(row1, light)), encoded_of(dot(row2, light)));
}

mat3 matrix_of(vec4 q) { // w, x, y, z of unit length
  float w = q.x, x = q.y, y = q.z, z = q.w;
  return mat3(vec3(1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + w * z), 2.0 * (x * z - w * y)),
              vec3(2.0 * (x * y - w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z + w * x)),
              vec3(2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y)));
}

int joined(vec2 parts) { // whole numbers beyond a float's 24 bits travel in two parts
  return int(parts.x) * 65536 + int(parts.y);
}

int first_texel(vec2 cloud, int splat, int per_splat) { // of a splat's record; `cloud` is its cloud's first
  return joined(cloud) + splat * per_splat;
}

uint scrambled(uint x) { // PCG of Jarzynski and Olano, "Hash Functions for GPU Rendering", 2020
  x = x * 747796405u + 2891336453u;
  x = ((x >> ((x >> 28u) + 4u)) ^ x) * 277803737u;
  return (x >> 22u) ^ x;
}

void main() {
  int place_in_order = gl_InstanceID * QUADS_PER_BATCH + int(corner.z);
  bool is_drawn = place_in_order < modes.w; // the last batch has quads to spare
  place_in_order = min(place_in_order, modes.w - 1);
  int width = textureSize(draw_order, 0).x;
  vec4 drawn = texelFetch(draw_order, ivec2(place_in_order % width, place_in_order / width), 0);
  int splat = joined(drawn.xy);
  int instance = int(drawn.z);
  vec4 row0 = instance_texel(instance * INSTANCE_TEXELS); // camera_from_object, three rows
  vec4 row1 = instance_texel(instance * INSTANCE_TEXELS + 1);
  vec4 row2 = instance_texel(instance * INSTANCE_TEXELS + 2);
  vec4 eye = instance_texel(instance * INSTANCE_TEXELS + 3); // in object space; forward for an orthographic camera. Highest SH band
  vec4 place = instance_texel(instance * INSTANCE_TEXELS + 4); // first texel of the cloud in two parts, texels per splat, sweeps
  int record = first_texel(place.xy, splat, int(place.z));

  bool parallel = modes.x != 0;
  vec4 position = splat_texel(record); // and opacity
  vec4 object_point = vec4(position.xyz, 1.0);
  vec3 mu = vec3(dot(row0, object_point), dot(row1, object_point), dot(row2, object_point));
  float largest = max(max(abs(mu.x), abs(mu.y)), abs(mu.z));
  float unit = parallel ? 1.0 / max(lens.x, lens.y) : largest * length(mu / largest);
  mu /= unit;
  mat3 linear = transpose(mat3(row0.xyz, row1.xyz, row2.xyz));
  vec4 look = instance_texel(instance * INSTANCE_TEXELS + 5); // size, opacity, variance of the filter [px^2], 1 for Eq. 17
  vec3 scale = splat_texel(record + 2).xyz * look.x / unit;
  mat3 M = linear * matrix_of(splat_texel(record + 1));
  M[0] *= min(scale.x, LARGEST_S / max(length(M[0]), 1e-20));
  M[1] *= min(scale.y, LARGEST_S / max(length(M[1]), 1e-20));
  M[2] *= min(scale.z, LARGEST_S / max(length(M[2]), 1e-20));

  // Section 5: a pixel's area where the mean is, across the ray. (mu.z is the cosine: mu has length 1.)
  float filter_variance = look.z / (lens.x * lens.y) * (parallel ? 1.0 / (unit * unit) : mu.z * mu.z * mu.z);
  vec3 ray = parallel ? vec3(0.0, 0.0, 1.0) : mu;
  float o = look.y < cut.z ? min(position.w * look.y, 1.0) : look.y;
  Quad quad = quad_of(ray, M, int(place.w), o, filter_variance, cut.x, look.w != 0.0, parallel);

  vec2 z = quad.z_ray * corner.xy;                     // a column of Z_ray
  vec3 v = quad.q0 * z.x + quad.q1 * z.y + mu;       // a column of V_ray = T_ray H(Z_ray), Eq. 15
  float w = parallel ? 1.0 : v.z;
  vec2 px = lens.xy * v.xy * (parallel ? unit : 1.0) + lens.zw * w; // times w, from the window's corner
  // Depth 0 is inside the clip volume wherever w > 0: no quad is cut by the near or the far plane (section 4.1).
  gl_Position = vec4(2.0 * px / window.zw - w, 0.0, w);
  float reach = max(max(abs(gl_Position.x), abs(gl_Position.y)), abs(w));
  if (!is_drawn || !quad.visible || !(reach < 1e30)) { // a NaN fails too
    gl_Position = vec4(2.0, 2.0, 0.0, 1.0); // all corners in one place, outside: nothing is drawn
    z = vec2(0.0);
    v = vec3(0.0, 0.0, 1.0);
    quad.o = 0.0;
    quad.inverse_c2 = 0.0;
  }
  quad_point = vec3(z, v.z * unit);
  inverse_c2 = quad.inverse_c2;
  vec3 towards = parallel ? eye.xyz : position.xyz - eye.xyz;
  float distance_object = length(towards);
  vec3 direction = distance_object > 0.0 ? towards / distance_object : vec3(0.0);
  vec3 trained = colour_towards(record, int(eye.w), direction);
  trained += 0.5 * drawn.w * (vec3(HIGHLIGHT) - trained);
  radiance = vec4(graded(trained, instance), quad.o);
  random_key = uvec2(uint(splat), scrambled(uint(modes.z) ^ scrambled(uint(instance))));
}
