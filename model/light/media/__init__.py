# SPDX-License-Identifier: GPL-3.0-or-later
"""Participating media: how much light passes, and how much they scatter."""
