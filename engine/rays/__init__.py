# SPDX-License-Identifier: GPL-3.0-or-later
"""Method *rays*: hardware-rasterised RayGS (Rota Bulò, Bartolovic, Porzi, Kontschieder).

Every splat is a quad in space that the graphics hardware rasterises; the opacity is exact on every ray.

| stage, in order   | file                                        | paper            |
|-------------------|---------------------------------------------|------------------|
| texels            | `texels.py`                                 |                  |
| culling           | `support.py`, `raygs.py`                    | §3.2, §4.1, §5   |
| order             | `order.py`                                  | Eq. 1            |
| corners, colour   | `vertex.glsl`, `raygs.glsl`, `harmonics.glsl` | §3.2, §4.1, §5 |
| opacity           | `fragment.glsl`, `random.glsl`              | §4.2             |

`raygs.py` is `raygs.glsl` in Warp, function by function; `meet.py` finds what a ray meets without drawing.
`interface.py` declares what the shaders read and write, once for all hosts; `host.py` says what a host does;
`moderngl_device.py` is the one outside Blender. `uploads.py` keeps what they hold; `method.py` runs a frame.
"""
