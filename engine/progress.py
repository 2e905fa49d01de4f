# SPDX-License-Identifier: GPL-3.0-or-later
"""How the engine tells a host how far it is."""

from __future__ import annotations

from collections.abc import Callable

Progress = Callable[[float, str], None]
"""Called between launches and blocks of a file with the fraction done and a word on what is being done.

Raise `Cancelled` in it to stop.
"""
