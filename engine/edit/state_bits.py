# SPDX-License-Identifier: GPL-3.0-or-later
"""The bits of a splat's state as plain numbers, for hosts that have not started Warp; `state` says what they mean."""

from __future__ import annotations

SELECTED = 1
HIDDEN = 2
DELETED = 4
LOCKED = 8  # shown, but neither selectable nor changeable
SEPARATED = 16  # deleted because it became another capture: not to be restored, or there would be two of it
# Bits 5 to 31 are free; whoever takes one adds it here.

NOT_SELECTABLE = HIDDEN | DELETED | LOCKED

HIGHLIGHT = (1.0, 0.45, 0.05)
"""What selected splats are mixed with while a capture is edited (sRGB-encoded), half and half."""
