# SPDX-License-Identifier: GPL-3.0-or-later
"""Method *points*: Gaussian Point Splatting (Rijsdijk et al. 2026, doi 10.1145/3811272).

Every splat throws opaque, pixel-sized points; the nearest wins; the mean over samples is the picture.

| stage, in order | file           | paper           |
|-----------------|----------------|-----------------|
| rates           | `rates.py`     | §3.3, Eq. 3     |
| counts          | `counts.py`    | §3.4            |
| distribution    | `distribute.py`| §3.2            |
| splatting       | `splat.py`     | §3.1, 3.4, A, B |
| resolve         | `resolve.py`   | §3.1            |

`method.py` runs them in this order.
"""
