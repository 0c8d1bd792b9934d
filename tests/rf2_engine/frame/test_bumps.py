# SPDX-License-Identifier: GPL-3.0-or-later
"""Matte surfaces whose bumps are finer than a pixel send on as much light as in Cycles."""
import pytest

from tests.rf2_engine.f12 import material
from tests.rf2_engine.rooms import assert_alike, beside_cycles, lamp, rectangle


def gravel(scale=60):
    """A matte material with steep bumps, `scale` of them to a metre."""
    made = material("Gravel", (0.6, 0.6, 0.6))
    tree = made.node_tree
    surface, place, noise, bump = tree.nodes["Principled BSDF"], *(tree.nodes.new(f"ShaderNode{kind}") for kind in (
        "TexCoord", "TexNoise", "Bump"))
    surface.inputs["Roughness"].default_value, surface.inputs["Specular IOR Level"].default_value = 1, 0
    noise.inputs["Scale"].default_value, noise.inputs["Detail"].default_value = scale, 4
    bump.inputs["Strength"].default_value, bump.inputs["Distance"].default_value = 1, 0.1
    tree.links.new(place.outputs["Object"], noise.inputs["Vector"])
    tree.links.new(noise.outputs[0], bump.inputs["Height"])
    tree.links.new(bump.outputs[0], surface.inputs["Normal"])
    return made


@pytest.mark.parametrize("light_of", ["SUN", "sky"])
def test_a_gravel_yard_is_as_dark_as_its_bumps_make_it(scene, tmp_path, light_of):
    """As bright as a smooth one it would be half again too bright."""
    rectangle(scene, "yard", (-9, -9, 0), (9, -9, 0), (9, 9, 0), (-9, 9, 0), of=gravel())
    scene.world.node_tree.nodes["Background"].inputs["Color"].default_value = (*(3 * [float(light_of == "sky")]), 1)
    if light_of == "SUN":
        lamp(scene, kind="SUN", turn=(0.5, 0.2, 0), energy=3)
    scene.camera.location, scene.camera.rotation_euler = (0, -4, 4), (0.785, 0, 0)
    scene.renderformer_v2.light = "NETWORK"
    assert_alike(*beside_cycles(scene, tmp_path), rtol=0.1)
