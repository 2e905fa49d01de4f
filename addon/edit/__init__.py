# SPDX-License-Identifier: GPL-3.0-or-later
"""Edit Splats: the mode, the session behind it, and its keys, menus and panels (design/edit_mode.md)."""
