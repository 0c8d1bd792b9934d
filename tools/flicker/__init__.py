# SPDX-License-Identifier: GPL-3.0-or-later
"""Measure how much the engine's pictures flicker from frame to frame."""
