# SPDX-License-Identifier: GPL-3.0-or-later
"""Light without any network: `estimate_light` (estimate.py) makes a SurfaceLight of a scene and a view."""
