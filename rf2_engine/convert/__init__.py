# SPDX-License-Identifier: GPL-3.0-or-later
"""Depsgraph in, arrays out: one module per Blender concept."""
