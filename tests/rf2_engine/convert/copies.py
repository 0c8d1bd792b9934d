# SPDX-License-Identifier: GPL-3.0-or-later
"""Data-blocks as conversions copy them."""
import bpy

from bl_ext.user_default.renderformer_v2.rf2_engine.convert.copying.blocks import Blocks


def copied(block):
    """A material, a lamp or a world at the frame of the active scene, not evaluated; None stays None."""
    return Blocks(bpy.context.scene.frame_current).of(block)
