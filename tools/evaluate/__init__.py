# SPDX-License-Identifier: GPL-3.0-or-later
"""Compare the engine's pictures with those of Cycles."""
