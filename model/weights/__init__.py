# SPDX-License-Identifier: GPL-3.0-or-later
"""Weights: those that come with the add-on, presets, and files of checkpoints."""
