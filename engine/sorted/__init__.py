# SPDX-License-Identifier: GPL-3.0-or-later
"""Method *sorted*: the tile renderer of Splatshop (Schütz et al. 2025, doi 10.1111/cgf.70214), §3.2.1.

Noise-free: what captures are trained for, the reference for the other methods, and fast on a CPU.

| stage, in order   | file                          |
|-------------------|-------------------------------|
| depth order       | `order.py`                    |
| tile fragments    | `tiles.py`                    |
| blending          | `blend.py`, `blend_cuda.py`   |

`method.py` runs them in this order. Where we differ: the tile test is exact (no false negatives), and small splats are
only left out on request.
"""
