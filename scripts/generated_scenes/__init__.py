# SPDX-License-Identifier: GPL-3.0-or-later
"""Large scenes that make themselves on the device, for benchmarks: no file is needed, and none could hold them."""

from __future__ import annotations

from .city import GeneratedCity
from .displaced_copies import DisplacedCopies

__all__ = ["DisplacedCopies", "GeneratedCity"]
