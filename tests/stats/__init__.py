# SPDX-License-Identifier: GPL-3.0-or-later
"""Statistics that decide whether a stochastic renderer is right: no tolerance chosen by eye, no variance floor."""
