# SPDX-License-Identifier: GPL-3.0-or-later
"""Lamps and suns as emitting triangles."""
