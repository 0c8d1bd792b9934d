# SPDX-License-Identifier: GPL-3.0-or-later
"""Run Cycles inside our own engine, or in a Blender of its own."""
