# SPDX-License-Identifier: GPL-3.0-or-later
"""Volumes, smoke and fog as occupied cells."""
