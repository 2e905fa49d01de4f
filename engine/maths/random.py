# SPDX-License-Identifier: GPL-3.0-or-later
"""Counter-based random numbers: equal keys, equal bits, on every device and with any number of threads.

The hash is pcg3d of Jarzynski and Olano, "Hash Functions for GPU Rendering" (JCGT 9(3), 2020): three integers in,
three well-mixed integers out. The key is (splat, stream, point), where `stream` mixes seed, sample and instance.
"""

from __future__ import annotations

import warp as wp

wp.set_module_options({"enable_backward": False})

MASK_64 = 0xFFFFFFFFFFFFFFFF

# The same in C++, for native kernels: defines pcg3d(x, y, z) on unsigned lvalues.
PCG3D_NATIVE = """
    auto pcg3d = [](unsigned& x, unsigned& y, unsigned& z) {
        x = x * 1664525u + 1013904223u; y = y * 1664525u + 1013904223u; z = z * 1664525u + 1013904223u;
        x += y * z; y += z * x; z += x * y;
        x ^= x >> 16u; y ^= y >> 16u; z ^= z >> 16u;
        x += y * z; y += z * x; z += x * y;
    };
"""


@wp.func
def pcg3d(key: wp.vec3ui) -> wp.vec3ui:
    a = wp.uint32(1664525)
    c = wp.uint32(1013904223)
    s = wp.uint32(16)
    x = key[0] * a + c
    y = key[1] * a + c
    z = key[2] * a + c
    x += y * z
    y += z * x
    z += x * y
    x = x ^ (x >> s)
    y = y ^ (y >> s)
    z = z ^ (z >> s)
    x += y * z
    y += z * x
    z += x * y
    return wp.vec3ui(x, y, z)


@wp.func
def uniform_open(bits: wp.uint32) -> wp.float32:
    """(0, 1], evenly spaced by 2⁻³² near zero, where small probabilities are decided."""
    return (float(bits) + 0.5) * 2.3283064365386963e-10


def _splitmix64(z: int) -> int:
    """The splitmix64 generator's finaliser: 64 bits in, 64 well-mixed bits out."""
    z = (z + 0x9E3779B97F4A7C15) & MASK_64
    z = (z ^ (z >> 30)) * 0xBF58476D1CE4E5B9 & MASK_64
    z = (z ^ (z >> 27)) * 0x94D049BB133111EB & MASK_64
    return z ^ (z >> 31)


def stream_key(seed: int, sample: int, instance: int) -> int:
    """32 bits that stand for (seed, sample, instance)."""
    return _splitmix64(_splitmix64(_splitmix64(seed) ^ sample) ^ instance) >> 32
