# SPDX-License-Identifier: GPL-3.0-or-later
"""Meshes, and how many triangles of them the network is given."""
