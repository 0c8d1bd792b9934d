# SPDX-License-Identifier: GPL-3.0-or-later
"""Meshes, and the number of their triangles."""
