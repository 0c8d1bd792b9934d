# SPDX-License-Identifier: GPL-3.0-or-later
"""Copy from Blender's data: the result is plain Python and stays valid after the data are freed."""
