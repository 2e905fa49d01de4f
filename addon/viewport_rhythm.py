# SPDX-License-Identifier: GPL-3.0-or-later
"""How often a viewport shows what it has accumulated: while Blender redraws its window keys wait."""

from __future__ import annotations

SHOW_INTERVAL = 0.06  # [s] at least between pictures of one accumulation: each is read back, converted and redrawn
LONGEST_SHOW_INTERVAL = 20.0  # [s] that slow redraws make of it
REDRAWING = 0.05  # of the time at most: while Blender redraws its window, keys wait
ANSWERED_BY = 0.04  # [s] a key may wait: redraws that take longer hold some keys up for too long
HELD_UP = 0.005  # of the time at most, during which a key would wait longer than that
SECOND_PICTURE = 0.4  # [s] after the first one where that is noisy, whatever redraws cost: most of the noise goes then
SHOW_GROWTH = 2.0  # samples of a picture over those of the one before: later samples change less and less
SLOW_SHOW_GROWTH = 4.0  # the same where redraws hold up keys: half the noise


def is_worth_showing(samples: int, shown_samples: int, since: float, redraw_seconds: float, noisy: bool) -> bool:
    """Whether the picture has changed enough since the last one, and redraws have not held up keys for too long.

    `since` the last picture [s]; `redraw_seconds` that Blender takes for its window: 0.126 without a graphics card (two
    cores, llvmpipe, 1280×800), and with one so little that only SHOW_INTERVAL counts.
    """
    slow = redraw_seconds > ANSWERED_BY
    if samples < (SLOW_SHOW_GROWTH if slow else SHOW_GROWTH) * shown_samples:
        return False
    interval = max(SHOW_INTERVAL, redraw_seconds / REDRAWING, (redraw_seconds - ANSWERED_BY) / HELD_UP)
    longest = SECOND_PICTURE if noisy and shown_samples == 1 else LONGEST_SHOW_INTERVAL
    return since > min(interval, longest)
