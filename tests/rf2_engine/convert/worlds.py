# SPDX-License-Identifier: GPL-3.0-or-later
"""Worlds with an image or a sky, for the tests of this folder."""
from tests.rf2_engine.convert.cycles_reference import world


def image_world(image, rotation=(0, 0, 0), strength=1.0):
    """(world, Environment Texture node)."""
    made, tree, background = world()
    texture, mapping, coordinate = (tree.nodes.new("ShaderNode" + n) for n in ("TexEnvironment", "Mapping", "TexCoord"))
    texture.image, mapping.inputs["Rotation"].default_value = image, rotation
    background.inputs["Strength"].default_value = strength
    tree.links.new(coordinate.outputs["Generated"], mapping.inputs["Vector"])
    tree.links.new(mapping.outputs[0], texture.inputs[0])
    tree.links.new(texture.outputs[0], background.inputs["Color"])
    return made, texture


def sky_world(elevation, disc=False, size=0.0095, kind=("NISHITA", "SINGLE_SCATTERING")):
    """kind: the first of these that this version of Blender knows."""
    made, tree, background = world()
    sky = tree.nodes.new("ShaderNodeTexSky")
    known = sky.bl_rna.properties["sky_type"].enum_items.keys()
    sky.sky_type = next(name for name in kind if name in known)
    sky.sun_elevation, sky.sun_rotation, sky.sun_disc, sky.sun_size = elevation, 0.7, disc, size
    tree.links.new(sky.outputs[0], background.inputs["Color"])
    return made
