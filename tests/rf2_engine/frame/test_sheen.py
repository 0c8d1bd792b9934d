# SPDX-License-Identifier: GPL-3.0-or-later
"""Velvet sends on the light that grazes it, as in Cycles."""
import bpy
import pytest

from tests.rf2_engine.f12 import material
from tests.rf2_engine.rooms import assert_alike, beside_cycles, lamp, rectangle


def velvet(roughness=0.5, node=False):
    made = material("Velvet", (0.1, 0.01, 0.03))
    tree = made.node_tree
    shader = tree.nodes["Principled BSDF"]
    if node:
        shader = tree.nodes.new("ShaderNodeBsdfSheen")
        tree.links.new(shader.outputs[0], tree.nodes["Material Output"].inputs["Surface"])
        shader.inputs["Color"].default_value, shader.inputs["Roughness"].default_value = (1, 0.8, 0.6, 1), roughness
        return made
    for name, value in (("Roughness", 1.0), ("Sheen Weight", 1.0), ("Sheen Roughness", roughness)):
        shader.inputs[name].default_value = value
    return made


@pytest.mark.parametrize("light", [pytest.param("TRACED", marks=pytest.mark.slow), "NETWORK"])
@pytest.mark.parametrize("place", ["above", "beside"])
@pytest.mark.parametrize("of", [velvet, lambda: velvet(0.8), lambda: velvet(node=True)], ids=["half", "rough", "node"])
def test_velvet_is_as_bright_as_in_cycles(scene, tmp_path, light, place, of):
    """As matte it would be nearly twice as bright with a lamp above it, and darker with one beside it."""
    cloth = of()
    rectangle(scene, "Floor", (-3, -3, 0), (3, -3, 0), (3, 3, 0), (-3, 3, 0), of=cloth)
    bpy.ops.mesh.primitive_uv_sphere_add(segments=64, ring_count=32, location=(0, 0, 1))
    bpy.context.object.data.shade_smooth()
    bpy.context.object.data.materials.append(cloth)
    scene.world.node_tree.nodes["Background"].inputs["Color"].default_value = (0.02, 0.02, 0.02, 1)
    scene.camera.location, scene.camera.data.lens = (0, -7, 1.5), 35
    lamp(scene, *{"above": ((0, 0, 5), (0, 0, 0)), "beside": ((-5, -3, 1), (1.3, 0, -1.0))}[place], energy=300)
    scene.renderformer_v2.light = light
    ours, cycles = beside_cycles(scene, tmp_path)
    bpy.data.objects.remove(bpy.context.object)
    assert_alike(ours, cycles, rtol=0.1)
