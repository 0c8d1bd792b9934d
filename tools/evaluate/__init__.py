# SPDX-License-Identifier: GPL-3.0-or-later
"""How close the engine's pictures are to those of Cycles."""
