# SPDX-License-Identifier: GPL-3.0-or-later
"""The part of a conversion that reads Blender's data: what it gives is plain Python, and outlives them."""
