# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests of engine/edit: every operation, its undo, and NumPy's float64 answer to the same question."""
