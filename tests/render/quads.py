# SPDX-License-Identifier: GPL-3.0-or-later
"""Quads of RayGS for many primitives at once, by `raygs.py` and by `raygs.glsl`."""

from __future__ import annotations

import numpy as np
import warp as wp
from scipy.spatial.transform import Rotation

from stipple.engine.device import choose_device, launch
from stipple.engine.rays import raygs, support
from stipple.engine.renderer import Renderer
from tests.render.shader_probe import run_probe

wp.set_module_options({"enable_backward": False})

P_MIN = 1.0 / 255.0
PROBE = """
in vec3 m0; // columns of M
in vec3 m1;
in vec3 m2;
in vec3 x;
in vec3 numbers; // o, variance of the filter, p_min
in ivec3 how;    // sweeps, modulate, parallel
out vec3 q0;
out vec3 q1;
out vec4 rest;
void main() {
  Quad quad = quad_of(x, mat3(m0, m1, m2), how.x, numbers.x, numbers.y, numbers.z, how.y != 0, how.z != 0);
  q0 = quad.visible ? quad.q0 : vec3(0.0);
  q1 = quad.visible ? quad.q1 : vec3(0.0);
  rest = quad.visible ? vec4(quad.z_ray, quad.inverse_c2, quad.o, 1.0) : vec4(0.0);
}
"""


@wp.struct
class Asked:
    """A row of what PROBE asks for."""

    m0: wp.vec3
    m1: wp.vec3
    m2: wp.vec3
    x: wp.vec3
    numbers: wp.vec3
    how: wp.vec3i


@wp.kernel
def quads_kernel(first: wp.int32, asked: wp.array(dtype=Asked), found: wp.array(dtype=raygs.Quad)) -> None:
    i = first + wp.tid()
    a = asked[i]
    M = wp.matrix_from_cols(a.m0, a.m1, a.m2)  # noqa: N806  (the paper's)
    found[i] = raygs.quad_of(a.x, M, a.how[0], a.numbers[0], a.numbers[1], a.numbers[2], a.how[1] != 0, a.how[2] != 0)


@wp.kernel
def meet_kernel(
    first: wp.int32,
    found: wp.array(dtype=raygs.Quad),
    mu: wp.array(dtype=wp.vec3),
    x: wp.array(dtype=wp.vec3),
    met: wp.array(dtype=wp.vec4),
) -> None:
    i = first + wp.tid()
    z = raygs.on_quad(found[i], mu[i], wp.vec3(), x[i])
    z2 = z[0] * z[0] + z[1] * z[1]
    inverse_c2 = found[i].inverse_c2
    divergence = raygs.D_ray(z2, inverse_c2)
    met[i] = wp.vec4(divergence, z[2] * raygs.tau_on_quad(z2, inverse_c2), raygs.omega(found[i].o, divergence), z2)


@wp.kernel
def beside_kernel(
    first: wp.int32, asked: wp.array(dtype=Asked), planes: wp.array(dtype=wp.vec4), beside: wp.array(dtype=wp.bool)
) -> None:
    """Whether `support` takes each primitive to be beyond its plane."""
    i = first + wp.tid()
    a = asked[i]
    frustum = support.Frustum()
    frustum.left = planes[i]
    frustum.right = planes[i]
    frustum.top = planes[i]
    frustum.bottom = planes[i]
    primitive = support.Primitive()
    primitive.mu = a.x
    primitive.x = a.x
    primitive.M = wp.matrix_from_cols(a.m0, a.m1, a.m2)
    primitive.unit = 1.0
    primitive.o = a.numbers[0]
    primitive.filter_variance = a.numbers[1]
    beside[i] = support.is_beside(frustum, primitive, a.how[0], a.numbers[2], a.how[2] != 0)


def random_questions(count: int, seed: int) -> np.ndarray:
    """(N,) `Asked`: sizes over twelve decades of the distance, axes to 1 : 10⁴, half of them sheared, every switch."""
    rng = np.random.default_rng(seed)
    s = 10.0 ** rng.uniform(-4, 0, (count, 3)) * 10.0 ** rng.uniform(-8, 4, (count, 1))
    m = Rotation.random(count, random_state=seed).as_matrix() * s[:, None, :]
    sheared = rng.random(count) < 0.5
    m[sheared] = np.einsum("nij,njk->nik", rng.normal(size=(count, 3, 3)), m)[sheared]
    asked = np.zeros(count, Asked.numpy_dtype())  # type: ignore[attr-defined]
    for k, name in enumerate(("m0", "m1", "m2")):
        asked[name] = m[:, :, k]
    x = rng.normal(size=(count, 3))
    parallel = rng.random(count) < 0.2
    asked["x"] = np.where(parallel[:, None], [0.0, 0.0, 1.0], x / np.linalg.norm(x, axis=1, keepdims=True))
    o = np.where(rng.random(count) < 0.05, 1e24, rng.uniform(0.0, 1.0, count))
    variance = np.where(rng.random(count) < 0.3, 0.0, 10.0 ** rng.uniform(-10, 0, count))
    asked["numbers"] = np.column_stack([o, variance, np.full(count, P_MIN)])
    asked["how"] = np.column_stack([np.where(sheared, 4, 0), rng.random(count) < 0.5, parallel])
    return asked


def in_warp(device: str, asked: np.ndarray) -> np.ndarray:
    """(N,) `Quad` by `raygs.py`."""
    held = choose_device(device)
    found = wp.zeros(len(asked), dtype=raygs.Quad, device=held)
    launch(quads_kernel, len(asked), [wp.array(asked, dtype=Asked, device=held), found], held)
    return found.numpy()


def in_glsl(rays: Renderer, asked: np.ndarray) -> np.ndarray:
    """(N,) `Quad` by `raygs.glsl`."""
    content = ("3f 3f 3f 3f 3f 3i", "m0", "m1", "m2", "x", "numbers", "how")
    row = run_probe(rays, PROBE, content, {"q0": 3, "q1": 3, "rest": 4}, asked).view(np.float32)
    found = np.zeros(len(asked), raygs.Quad.numpy_dtype())  # type: ignore[attr-defined]
    found["q0"], found["q1"], found["visible"] = row[:, :3], row[:, 3:6], row[:, 9] != 0
    found["z_ray"], found["inverse_c2"], found["o"] = row[:, 6:9].T
    return found
