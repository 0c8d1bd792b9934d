# SPDX-License-Identifier: GPL-3.0-or-later
"""Light that glass focuses, by photons."""
