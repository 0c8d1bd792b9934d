# SPDX-License-Identifier: GPL-3.0-or-later
"""All nodes that give values: bl_idname -> function of a NodeCall."""
from . import (
    blend,
    colors,
    coordinates,
    image_texture,
    input_nodes,
    lamp_nodes,
    maths,
    noise_texture,
    normal_map,
    object_info,
    pattern,
    sky,
    spectrum,
    vectors,
    voronoi_texture,
)

MODULES = (blend, colors, coordinates, image_texture, input_nodes, lamp_nodes, maths, noise_texture, normal_map,
           object_info, pattern, sky, spectrum, vectors, voronoi_texture)
FUNCTIONS = {kind: function for module in MODULES for kind, function in module.FUNCTIONS.items()}
