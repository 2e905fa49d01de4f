# SPDX-License-Identifier: GPL-3.0-or-later
"""Splats under an affine map: means, shapes and harmonics, worked out in float64 and rounded once.

Every kernel reads rows of one set of arrays and writes rows of another, or of the same. It does the same arithmetic
for a splat wherever that stands, so that doing a transform again gives the same bits.
"""

from __future__ import annotations

import numpy as np
import warp as wp

from ..device import launch
from .affine import Matrix, inverse
from .rows import Arrays, row_of
from .sh_rotation import band_matrices

wp.set_module_options({"enable_backward": False})

SWEEPS = 12  # of Jacobi's rotations; 3×3 converges to float64's last digits in at most 6
SAME = 1e-12  # a linear part closer to the identity than this turns nothing


@wp.struct
class GeometryMap:
    """An affine map, and what it does to shapes where it is a turn (or mirror) times a uniform scale."""

    linear: wp.mat33d
    translation: wp.vec3d
    turn: wp.quatd
    factor: wp.float64
    similar: wp.int32


@wp.struct
class Shape:
    scale: wp.vec3
    rotation: wp.vec4


@wp.func
def quaternion_of(q: wp.quatd) -> wp.vec4:
    """Normalised, w first."""
    u = wp.normalize(q)
    return wp.vec4(wp.float32(u[3]), wp.float32(u[0]), wp.float32(u[1]), wp.float32(u[2]))


@wp.func
def any_across(v: wp.vec3d) -> wp.vec3d:
    """A unit vector at right angles to the unit vector v."""
    zero = wp.float64(0.0)
    other = wp.vec3d(wp.float64(1.0), zero, zero)
    if wp.abs(v[0]) > wp.float64(0.7):
        other = wp.vec3d(zero, wp.float64(1.0), zero)
    return wp.normalize(wp.cross(v, other))


@wp.func
def shape_of(b: wp.mat33d, axes: wp.mat33d) -> Shape:
    """Lengths and directions of orthogonal columns; one without length gets a direction at right angles to the rest."""
    zero = wp.float64(0.0)
    sizes = wp.vec3d(zero, zero, zero)
    for k in range(3):
        sizes[k] = wp.sqrt(b[0, k] * b[0, k] + b[1, k] * b[1, k] + b[2, k] * b[2, k])
    shape = Shape()
    shape.scale = wp.vec3(wp.float32(sizes[0]), wp.float32(sizes[1]), wp.float32(sizes[2]))
    longest = wp.max(sizes)
    if longest == zero:
        shape.rotation = quaternion_of(wp.quat_from_matrix(axes))
        return shape
    a = wp.where(sizes[0] == longest, 0, wp.where(sizes[1] == longest, 1, 2))
    m = (a + 1) % 3
    n = (a + 2) % 3
    second = wp.where(sizes[m] >= sizes[n], m, n)
    ua = wp.normalize(wp.vec3d(b[0, a], b[1, a], b[2, a]))
    us = any_across(ua)
    if sizes[second] > longest * wp.float64(1e-14):
        us = wp.normalize(wp.vec3d(b[0, second], b[1, second], b[2, second]))
    um = us
    un = wp.cross(ua, us)
    if second == n:
        um = wp.cross(us, ua)
        un = us
    frame = wp.mat33d()
    for r in range(3):
        frame[r, a] = ua[r]
        frame[r, m] = um[r]
        frame[r, n] = un[r]
    shape.rotation = quaternion_of(wp.quat_from_matrix(frame))
    return shape


@wp.func
def mapped_ellipsoid(linear: wp.mat33d, scale: wp.vec3, axes: wp.mat33d) -> Shape:
    """Principal axes of an ellipsoid under any linear map: one-sided Jacobi on linear · axes · scale.

    Columns are turned pairwise until they are orthogonal; their lengths are the new scales and their directions the
    new axes, each near the column it came from. A flat disc keeps its zero.
    """
    zero = wp.float64(0.0)
    one = wp.float64(1.0)
    b = linear * axes
    for k in range(3):
        for r in range(3):
            b[r, k] = b[r, k] * wp.float64(scale[k])
    for _sweep in range(SWEEPS):
        for pair in range(3):
            p = wp.where(pair == 2, 1, 0)
            q = wp.where(pair == 0, 1, 2)
            bp = wp.vec3d(b[0, p], b[1, p], b[2, p])
            bq = wp.vec3d(b[0, q], b[1, q], b[2, q])
            alpha = wp.dot(bp, bp)
            beta = wp.dot(bq, bq)
            gamma = wp.dot(bp, bq)
            if wp.abs(gamma) > wp.float64(1e-16) * wp.sqrt(alpha * beta):
                zeta = (beta - alpha) / (wp.float64(2.0) * gamma)
                t = wp.where(zeta < zero, -one, one) / (wp.abs(zeta) + wp.sqrt(one + zeta * zeta))
                c = one / wp.sqrt(one + t * t)
                s = c * t
                for r in range(3):
                    b[r, p] = c * bp[r] - s * bq[r]
                    b[r, q] = s * bp[r] + c * bq[r]
    return shape_of(b, axes)


@wp.func
def moved(m: GeometryMap, p: wp.vec3) -> wp.vec3:
    q = m.linear * wp.vec3d(wp.float64(p[0]), wp.float64(p[1]), wp.float64(p[2])) + m.translation
    return wp.vec3(wp.float32(q[0]), wp.float32(q[1]), wp.float32(q[2]))


@wp.func
def reshaped(m: GeometryMap, scale: wp.vec3, rotation: wp.vec4) -> Shape:
    q = wp.quatd(wp.float64(rotation[1]), wp.float64(rotation[2]), wp.float64(rotation[3]), wp.float64(rotation[0]))
    if m.similar == 0:
        return mapped_ellipsoid(m.linear, scale, wp.quat_to_matrix(q))
    shape = Shape()
    shape.scale = wp.vec3(
        wp.float32(m.factor * wp.float64(scale[0])),
        wp.float32(m.factor * wp.float64(scale[1])),
        wp.float32(m.factor * wp.float64(scale[2])),
    )
    shape.rotation = quaternion_of(m.turn * q)
    return shape


@wp.kernel
def map_position_kernel(
    first: wp.int32,
    m: GeometryMap,
    from_rows: wp.array(dtype=wp.int32),
    source: wp.array(dtype=wp.vec3),
    to_rows: wp.array(dtype=wp.int32),
    target: wp.array(dtype=wp.vec3),
) -> None:
    i = first + wp.tid()
    target[row_of(to_rows, i)] = moved(m, source[row_of(from_rows, i)])


@wp.kernel
def map_shape_kernel(
    first: wp.int32,
    m: GeometryMap,
    from_rows: wp.array(dtype=wp.int32),
    old_scale: wp.array(dtype=wp.vec3),
    old_rotation: wp.array(dtype=wp.vec4),
    to_rows: wp.array(dtype=wp.int32),
    new_scale: wp.array(dtype=wp.vec3),
    new_rotation: wp.array(dtype=wp.vec4),
) -> None:
    i = first + wp.tid()
    row = row_of(from_rows, i)
    shape = reshaped(m, old_scale[row], old_rotation[row])
    row = row_of(to_rows, i)
    new_scale[row] = shape.scale
    new_rotation[row] = shape.rotation


TURN_BANDS_NATIVE = """
    // All of a splat's coefficients are read before any is written, so old and new may be the same row.
    float held[72];
    const float* from = (const float*)source.data + (size_t)old_row * count * 3;
    float* to = (float*)turned.data + (size_t)new_row * count * 3;
    for (int k = 0; k < count * 3; ++k) held[k] = from[k];
    const double* matrix = bands.data;
    const float* band = held;
    for (int size = 3, left = count; left > 0; size += 2) {
        for (int r = 0; r < size; ++r) {
            double red = 0.0, green = 0.0, blue = 0.0;
            for (int k = 0; k < size; ++k) {
                red += matrix[k] * band[3 * k];
                green += matrix[k] * band[3 * k + 1];
                blue += matrix[k] * band[3 * k + 2];
            }
            to[0] = (float)red; to[1] = (float)green; to[2] = (float)blue;
            to += 3;
            matrix += size;
        }
        band += 3 * size;
        left -= size;
    }
"""


@wp.func_native(TURN_BANDS_NATIVE)
def turn_bands(
    bands: wp.array(dtype=wp.float64),
    count: wp.int32,
    source: wp.array2d(dtype=wp.vec3),
    old_row: wp.int32,
    turned: wp.array2d(dtype=wp.vec3),
    new_row: wp.int32,
) -> None:
    """Coefficients of one splat under the bands' matrices, one after the other in `bands`."""
    ...


@wp.kernel
def turn_bands_kernel(
    first: wp.int32,
    bands: wp.array(dtype=wp.float64),
    count: wp.int32,
    from_rows: wp.array(dtype=wp.int32),
    source: wp.array2d(dtype=wp.vec3),
    to_rows: wp.array(dtype=wp.int32),
    turned: wp.array2d(dtype=wp.vec3),
) -> None:
    i = first + wp.tid()
    turn_bands(bands, count, source, row_of(from_rows, i), turned, row_of(to_rows, i))


class SplatMap:
    """An affine map (3, 4) ready to be applied to rows of splats; `parts` names the attributes it changes.

    Turning, mirroring, moving and uniform scale are exact to the rounding of float32. Uneven scale and shear are exact
    for means and shapes; the harmonics then follow the orthogonal matrix next to the map (its polar factor), because no
    harmonics of finite degree could follow the map itself.
    """

    def __init__(self, matrix: Matrix, sh_degree: int, device: wp.Device) -> None:
        self.matrix, self._sh_degree, self._device = matrix, sh_degree, device
        linear = matrix[:, :3]
        nearest = polar_rotation(linear)
        factor = np.cbrt(abs(np.linalg.det(linear)))
        proper = nearest if np.linalg.det(nearest) > 0 else -nearest  # an ellipsoid is its own point reflection
        similar = np.allclose(linear, factor * nearest, atol=1e-7 * factor)
        self._map = GeometryMap()
        self._map.linear = wp.mat33d(*linear.ravel())
        self._map.translation = wp.vec3d(*matrix[:, 3])
        self._map.turn = wp.quat_from_matrix(wp.mat33d(*proper.ravel()))
        self._map.factor, self._map.similar = factor, int(similar)
        self.turns = not np.allclose(nearest, np.eye(3), atol=SAME)
        bands = band_matrices(nearest, sh_degree) if self.turns else []
        flat = np.concatenate([band.ravel() for band in bands]) if bands else np.zeros(1)
        self._bands = wp.array(flat, dtype=wp.float64, device=device)
        reshapes = not np.allclose(linear, np.eye(3), atol=SAME)
        self.parts = ("position",) + ("scale", "rotation") * reshapes + ("base_rest",) * bool(bands)

    def inverse(self) -> SplatMap:
        """The map back; only close to this one's inverse once values are rounded."""
        back = SplatMap(inverse(self.matrix), self._sh_degree, self._device)
        back._map.turn = wp.quat_inverse(self._map.turn)  # of the two quaternions, the one that undoes the sign as well
        return back

    def run(
        self,
        count: int,
        from_rows: wp.array,
        old: Arrays,
        to_rows: wp.array,
        new: Arrays,
    ) -> None:
        """Map `count` splats: rows of the arrays `old` to rows of `new`, both by attribute; see `row_of` for the lists.

        `old` and `new` hold every attribute of `parts`, and may be the same.
        """
        rows = [self._map, from_rows, old["position"], to_rows, new["position"]]
        launch(map_position_kernel, count, rows, self._device)
        if "scale" in self.parts:
            inputs = [self._map, from_rows, old["scale"], old["rotation"], to_rows, new["scale"], new["rotation"]]
            launch(map_shape_kernel, count, inputs, self._device)
        if "base_rest" in self.parts:
            rest = old["base_rest"]
            inputs = [self._bands, rest.shape[1], from_rows, rest, to_rows, new["base_rest"]]
            launch(turn_bands_kernel, count, inputs, self._device)


def polar_rotation(linear: Matrix) -> Matrix:
    """The orthogonal matrix next to `linear` (3, 3); it mirrors where `linear` does."""
    u, _, vt = np.linalg.svd(linear)
    return u @ vt
