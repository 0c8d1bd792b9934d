# SPDX-License-Identifier: GPL-3.0-or-later
"""Seconds against triangles and resolution, beside Cycles."""
