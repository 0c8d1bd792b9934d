# SPDX-License-Identifier: GPL-3.0-or-later
"""The RenderFormer-V2 network in PyTorch and numpy; never imports bpy."""
