# SPDX-License-Identifier: GPL-3.0-or-later
"""All nodes that give values: bl_idname -> function of a NodeCall."""
from . import (
    blend,
    colors,
    coordinates,
    gabor,
    inputs,
    lamp,
    maths,
    noise,
    normal_map,
    object_info,
    pattern,
    sky,
    spectrum,
    texture,
    vectors,
    voronoi,
)

FUNCTIONS = (blend.FUNCTIONS | colors.FUNCTIONS | coordinates.FUNCTIONS | gabor.FUNCTIONS | inputs.FUNCTIONS
             | lamp.FUNCTIONS | maths.FUNCTIONS | noise.FUNCTIONS | normal_map.FUNCTIONS | object_info.FUNCTIONS
             | pattern.FUNCTIONS | sky.FUNCTIONS | spectrum.FUNCTIONS | texture.FUNCTIONS | vectors.FUNCTIONS
             | voronoi.FUNCTIONS)
