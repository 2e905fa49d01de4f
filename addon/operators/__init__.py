# SPDX-License-Identifier: GPL-3.0-or-later
"""Operators: what a user or a script tells Blender to do with captures."""
