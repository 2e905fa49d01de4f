# SPDX-License-Identifier: GPL-3.0-or-later
"""Operations that change captures. So far: transforms."""
