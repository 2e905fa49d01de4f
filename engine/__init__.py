# SPDX-License-Identifier: GPL-3.0-or-later
"""The renderer: NumPy and Warp, no Blender.

| to know …                                  | read                                   |
|--------------------------------------------|----------------------------------------|
| what goes in                               | `splats`, `scene`, `camera`, `settings`|
| what a frame does, in order                | `renderer`                             |
| what comes out                             | `film`, `colour`, `pictures`           |
| how a splat becomes an ellipse             | `staging`, `maths/projection`          |
| the two methods                            | `points/`, `sorted/`                   |
| where memory and threads are               | `buffers`, `device`                    |

Importing this package imports neither Warp nor Blender.
"""
