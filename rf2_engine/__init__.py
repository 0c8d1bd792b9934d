# SPDX-License-Identifier: GPL-3.0-or-later
"""The Blender side: the only code of the add-on that imports bpy."""
