# SPDX-License-Identifier: GPL-3.0-or-later
"""All nodes that give values: bl_idname -> function of a NodeCall."""
from . import (
    blend,
    colors,
    coordinates,
    input_nodes,
    lamp_nodes,
    maths,
    normal_map,
    object_info,
    pattern,
    sky,
    spectrum,
    vectors,
)
from .images import image_texture
from .noise import gabor, noise_texture, voronoi

FUNCTIONS = (blend.FUNCTIONS | colors.FUNCTIONS | coordinates.FUNCTIONS | gabor.FUNCTIONS | image_texture.FUNCTIONS
             | input_nodes.FUNCTIONS | lamp_nodes.FUNCTIONS | maths.FUNCTIONS | noise_texture.FUNCTIONS
             | normal_map.FUNCTIONS | object_info.FUNCTIONS | pattern.FUNCTIONS | sky.FUNCTIONS | spectrum.FUNCTIONS
             | vectors.FUNCTIONS | voronoi.FUNCTIONS)
