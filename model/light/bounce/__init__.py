# SPDX-License-Identifier: GPL-3.0-or-later
"""Indirect light: radiosity between patches, and final gather at points."""
