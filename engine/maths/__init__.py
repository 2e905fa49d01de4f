# SPDX-License-Identifier: GPL-3.0-or-later
"""Functions shared by the methods: `wp.func` for kernels, one subject per file."""
