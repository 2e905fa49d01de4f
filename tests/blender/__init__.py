# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests of the add-on inside a real Blender (bpy)."""
